// SPDX-License-Identifier: Apache-2.0
#include "tests/support/lot_run.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <utility>

#include "pipeline/correction/tube_values.h"

namespace bendloop::support {
namespace {

using pipeline::RowValueKind;

bool IsIn(const hal::BendProgram& nominal, const hal::BendProgram& tube,
          const pipeline::RowTolerances& tolerance) {
  for (std::size_t i = 0; i < nominal.rows.size(); ++i) {
    const hal::BendRow& n = nominal.rows[i];
    const hal::BendRow& t = tube.rows[i];
    if (std::abs(t.length_mm - n.length_mm) > *tolerance.length_mm) return false;
    if (i == nominal.bend_count()) break;
    if (std::abs(t.angle_deg - n.angle_deg) > *tolerance.angle_deg) return false;
    if (i > 0 &&
        std::abs(hal::WrapRotationDeg(t.rotation_deg - n.rotation_deg)) > *tolerance.rotation_deg) {
      return false;
    }
  }
  return true;
}

std::vector<double> Apart(const LotBender& bender, const hal::BendProgram& a,
                          const hal::BendProgram& b) {
  const pipeline::TubeValues values(a.bend_count());
  std::vector<double> apart;
  for (std::size_t j = 0; j < values.size(); ++j) {
    const auto [row, kind] = values[j];
    double off = pipeline::ValueOf(a.rows[row], kind) - pipeline::ValueOf(b.rows[row], kind);
    if (kind == RowValueKind::kRotation) off = hal::WrapRotationDeg(off);
    apart.push_back(off / pipeline::OfKind(bender.nature().scatter, kind));
  }
  return apart;
}

}  // namespace

std::vector<double> OffInScatters(const LotBender& bender, const hal::BendProgram& tube) {
  return Apart(bender, tube, bender.nominal());
}

std::vector<RunPart> RunLot(LotBender& bender, const LotControllerKind& kind, unsigned parts,
                            void (*before_part)(LotBender&, unsigned),
                            const pipeline::RowTolerances& tolerance) {
  const auto controller = kind.make(bender, tolerance);
  hal::BendProgram active = *pipeline::InitialProgram(bender.nominal(), bender.told());
  struct Waiting {
    hal::BendProgram program;
    std::size_t part;
  };
  std::deque<Waiting> belt;
  std::vector<RunPart> run;
  for (unsigned n = 1; n <= parts; ++n) {
    if (before_part != nullptr) before_part(bender, n);
    LotBender::Bent bent = bender.Bend(active);
    const bool in = IsIn(bender.nominal(), bent.tube, tolerance);
    run.push_back({std::move(bent.tube), bent.fate, in, controller->forecast(), 0});
    belt.push_back({active, run.size() - 1});
    if (belt.size() <= bender.overlap()) continue;
    const Waiting waiting = std::move(belt.front());
    belt.pop_front();
    hal::BendProgram next =
        controller->Next(waiting.program, bender.Measure(run[waiting.part].tube), active);
    for (const double move : Apart(bender, next, active)) {
      run[waiting.part].move = std::max(run[waiting.part].move, std::abs(move));
    }
    active = std::move(next);
  }
  return run;
}

}  // namespace bendloop::support
