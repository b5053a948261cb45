// SPDX-License-Identifier: Apache-2.0
#include "tests/support/lot_bender.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace bendloop::support {
namespace {

bool Happens(Rng& rng, double odds) { return Uniform(rng, 0, 1) < odds; }

double SomeOf(Rng& rng, double size) {
  return std::copysign(Uniform(rng, size, 2 * size), Uniform(rng, -1, 1));
}

// A random value of a row: length, rotation or angle, as the row has them.
double& AnyOf(Rng& rng, std::vector<hal::BendRow>& rows) {
  const std::size_t bends = rows.size() - 1;
  const std::size_t row = rng() % bends;
  switch (rng() % 3) {
    case 0:
      return rows[row].length_mm;
    case 1:
      return row > 0 ? rows[row].rotation_deg : rows[row].angle_deg;
    default:
      return rows[row].angle_deg;
  }
}

}  // namespace

std::string_view Name(BenderTemper temper) {
  switch (temper) {
    case BenderTemper::kSteady:
      return "steady";
    case BenderTemper::kDrifting:
      return "drifting";
    case BenderTemper::kJumping:
      return "jumping";
    case BenderTemper::kSlipping:
      return "slipping";
    case BenderTemper::kRough:
      return "rough";
    case BenderTemper::kMoody:
      break;
  }
  return "moody";
}

LotBender::LotBender(std::uint64_t seed, BenderTemper temper) : rng_(seed) { Draw(temper); }

LotBender::LotBender(std::uint64_t seed, hal::BendProgram nominal, BenderNature nature)
    : rng_(seed), nominal_(std::move(nominal)), nature_(std::move(nature)) {
  nature_.errors.resize(nominal_.rows.size());
  nature_.drifts.resize(nominal_.rows.size());
}

void LotBender::Draw(BenderTemper temper) {
  const int bends = 1 + static_cast<int>(rng_() % 5);
  nominal_ = RandomProgram(rng_, bends);
  nature_.springback_deg = Uniform(rng_, 0.3, 2.5);
  nature_.springback_part = Uniform(rng_, 0.01, 0.05);
  nature_.elongation_part = Uniform(rng_, 0.01, 0.05);
  nature_.backlash_deg = Uniform(rng_, 0, 0.4);
  // Against tolerances of 0.5 mm, 0.5 and 0.4 degrees: a Cp of 1.0 to 3.
  nature_.scatter = {Uniform(rng_, 0.05, 0.14), Uniform(rng_, 0.05, 0.14),
                     Uniform(rng_, 0.04, 0.12)};
  nature_.errors.resize(nominal_.rows.size());
  nature_.drifts.resize(nominal_.rows.size());
  for (hal::BendRow& row : nature_.errors) {
    row = {Uniform(rng_, -0.8, 0.8), Uniform(rng_, -0.8, 0.8), Uniform(rng_, -0.5, 0.5), {}};
  }
  // Setters know their springback to a third, and half of the stretch.
  const double known = Uniform(rng_, 0.67, 1.33);
  told_ = {known * (nature_.springback_deg + 20 * nature_.springback_part),
           known * (nature_.springback_deg + 120 * nature_.springback_part),
           100 * Uniform(rng_, 0.5, 1.5) * nature_.elongation_part};
  overlap_ = static_cast<unsigned>(rng_() % 4);
  const bool moody = temper == BenderTemper::kMoody;
  if (temper == BenderTemper::kDrifting || moody) {
    nature_.drift_deg = SomeOf(rng_, 0.008);
    if (Happens(rng_, 0.5)) AnyOf(rng_, nature_.drifts) = SomeOf(rng_, 0.006);
  }
  if (temper == BenderTemper::kJumping || moody) {
    // One of each in 400 tubes: a coil lasts for hundreds.
    nature_.coil_jumps = 0.0025;
    nature_.row_jumps = 0.0025;
  }
  if (temper == BenderTemper::kSlipping || moody) nature_.slips = 0.03;
  if (temper == BenderTemper::kRough || moody) {
    const double rougher = Uniform(rng_, 1.5, 2);
    nature_.scatter.length_mm *= rougher;
    nature_.scatter.rotation_deg *= rougher;
    nature_.scatter.angle_deg *= rougher;
  }
}

TubeFate LotBender::Suffer(hal::BendProgram& tube) {
  TubeFate fate;
  if (Happens(rng_, nature_.coil_jumps)) {
    const double to_deg = SomeOf(rng_, nature_.coil_jump_deg);
    nature_.springback_deg += to_deg;
    fate.jumped = true;
    for (std::size_t i = 0; i < tube.bend_count(); ++i) tube.rows[i].angle_deg -= to_deg;
  }
  if (Happens(rng_, nature_.row_jumps)) {
    std::vector<hal::BendRow> jump(tube.rows.size());
    AnyOf(rng_, jump) = SomeOf(rng_, nature_.row_jump);
    fate.jumped = true;
    for (std::size_t i = 0; i < jump.size(); ++i) {
      nature_.errors[i].length_mm += jump[i].length_mm;
      nature_.errors[i].rotation_deg += jump[i].rotation_deg;
      nature_.errors[i].angle_deg += jump[i].angle_deg;
      tube.rows[i].length_mm += jump[i].length_mm;
      tube.rows[i].rotation_deg += jump[i].rotation_deg;
      tube.rows[i].angle_deg += jump[i].angle_deg;
    }
  }
  double all_deg = slip_next_deg_;
  slip_next_deg_ = 0;
  fate.slipped = all_deg != 0;
  if (Happens(rng_, nature_.slips)) {
    fate.slipped = true;
    if (Happens(rng_, 0.3)) {
      all_deg += SomeOf(rng_, nature_.slip);
    } else {
      AnyOf(rng_, tube.rows) += SomeOf(rng_, nature_.slip);
    }
  }
  for (std::size_t i = 0; i < tube.bend_count(); ++i) tube.rows[i].angle_deg += all_deg;
  return fate;
}

LotBender::Bent LotBender::Bend(const hal::BendProgram& program) {
  ++bent_;
  Bent bent{Expected(program, nature_, bent_), {}};
  bent.fate = Suffer(bent.tube);
  past_.push_back(nature_);
  for (std::size_t i = 0; i < bent.tube.rows.size(); ++i) {
    hal::BendRow& row = bent.tube.rows[i];
    row.length_mm = std::max(0.0, row.length_mm + Gauss(rng_, nature_.scatter.length_mm));
    if (i == bent.tube.bend_count()) break;
    row.angle_deg += Gauss(rng_, nature_.scatter.angle_deg);
    if (i > 0) row.rotation_deg += Gauss(rng_, nature_.scatter.rotation_deg);
    row.rotation_deg = hal::WrapRotationDeg(row.rotation_deg);
  }
  return bent;
}

hal::BendProgram LotBender::Expected(const hal::BendProgram& program, std::uint32_t number,
                                     std::uint32_t as_of) const {
  return Expected(program, past_[as_of - 1], number);
}

hal::BendProgram LotBender::Expected(const hal::BendProgram& program, const BenderNature& nature,
                                     double number) {
  hal::BendProgram tube = program;
  const std::size_t bends = tube.bend_count();
  for (std::size_t i = 0; i <= bends; ++i) {
    const hal::BendRow& error = nature.errors[i];
    const hal::BendRow& drift = nature.drifts[i];
    hal::BendRow& row = tube.rows[i];
    row.length_mm += error.length_mm + number * drift.length_mm;
    if (i == bends) break;
    row.angle_deg -=
        nature.springback_deg + nature.springback_part * row.angle_deg + number * nature.drift_deg;
    row.angle_deg += error.angle_deg + number * drift.angle_deg;
    if (i == 0) continue;
    row.rotation_deg += error.rotation_deg + number * drift.rotation_deg -
                        std::copysign(0.5 * nature.backlash_deg, row.rotation_deg);
  }
  for (std::size_t i = 0; i < bends; ++i) {
    const double arc_mm =
        tube.rows[i].bend_radius_mm.value_or(0) * tube.rows[i].angle_deg * std::numbers::pi / 180;
    tube.rows[i].length_mm += 0.5 * nature.elongation_part * arc_mm;
    tube.rows[i + 1].length_mm += 0.5 * nature.elongation_part * arc_mm;
  }
  return tube;
}

LotBender::Scan LotBender::Measure(const hal::BendProgram& tube) {
  Scan scan{tube, ConstantSigma(tube, 0.03, 0.03, 0.015), {}};
  const std::size_t bends = tube.bend_count();
  const bool is_vague = Happens(rng_, vague_ends);
  if (is_vague) scan.sigma.rows[bends].length_mm = 0.4;
  for (std::size_t i = 0; i < tube.rows.size(); ++i) {
    hal::BendRow& row = scan.measured.rows[i];
    row.length_mm += Gauss(rng_, scan.sigma.rows[i].length_mm);
    if (i == bends) break;
    if (i > 0) {
      row.rotation_deg =
          hal::WrapRotationDeg(row.rotation_deg + Gauss(rng_, scan.sigma.rows[i].rotation_deg));
    }
    // Where a shallow bend begins is hardly seen: its straight and its angle trade.
    constexpr double kShallowDeg = 40;
    if (tube.rows[i].angle_deg > kShallowDeg) {
      row.angle_deg += Gauss(rng_, scan.sigma.rows[i].angle_deg);
      continue;
    }
    const double together = Gauss(rng_, 1);
    const double coefficient = 0.95;
    scan.sigma.rows[i].angle_deg = 0.06;
    row.angle_deg += 0.06 * together;
    const double length_mm = scan.sigma.rows[i].length_mm;
    const double extra_mm = length_mm * coefficient / std::sqrt(1 - coefficient * coefficient);
    row.length_mm -= extra_mm * together;
    scan.sigma.rows[i].length_mm = std::hypot(length_mm, extra_mm);
    scan.correlations.push_back(
        {{i, pipeline::RowValueKind::kLength}, {i, pipeline::RowValueKind::kAngle}, -coefficient});
  }
  return scan;
}

}  // namespace bendloop::support
