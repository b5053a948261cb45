// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/makeable_bends.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "hal/spine.h"
#include "pipeline/structure/structure_moves.h"

namespace bendloop::pipeline {
namespace {

// By trial: clamps are longer.
struct ClampSettings {
  // [of r_P] Of a straight between two bends that may be one: [degrees] they turn nearly the same
  // way, or one of them is slight and has hardly a plane.
  double between = 1.0, turned_deg = 15.0, slight_deg = 10.0;
  // [of r_P] Of the tube from where an outermost bend begins: flares and nuts are half as long.
  double end = 3.0;
};
constexpr ClampSettings kClamp;

// A bend and the one before it.
bool MayBeOne(const hal::BendProgram& program, std::size_t bend, double pipe_radius_mm) {
  const auto& rows = program.rows;
  return rows[bend].length_mm < kClamp.between * pipe_radius_mm &&
         (std::abs(rows[bend].rotation_deg) < kClamp.turned_deg ||
          std::min(rows[bend].angle_deg, rows[bend - 1].angle_deg) < kClamp.slight_deg);
}

}  // namespace

std::size_t LeastMadeBends(const SurfaceFit& found) {
  const std::size_t bends = found.tube.program.bend_count();
  const double r_mm = found.tube.pipe_radius_mm;
  std::vector<std::size_t> first;  // of the bends that may be one
  for (std::size_t i = 0; i < bends; ++i) {
    if (i == 0 || !MayBeOne(found.tube.program, i, r_mm)) first.push_back(i);
  }
  const double few_samples = kClamp.end * r_mm * UsualSamplesPerMm(found);
  const auto is_at_end = [&](std::size_t from_segment, std::size_t to_segment) {
    double samples = 0;
    for (std::size_t k = from_segment; k < to_segment; ++k) samples += found.segment_samples[k];
    return samples < few_samples;
  };
  // From the ends on.
  std::size_t last = first.size(), begin = 0;
  while (last > 0 && is_at_end(2 * first[last - 1] + 1, 2 * bends + 1)) --last;
  while (begin < last &&
         is_at_end(0, begin + 1 < first.size() ? 2 * first[begin + 1] : 2 * bends)) {
    ++begin;
  }
  return last - begin;
}

}  // namespace bendloop::pipeline
