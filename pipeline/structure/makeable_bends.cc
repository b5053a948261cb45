// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/makeable_bends.h"

#include <vector>

#include "hal/spine.h"
#include "pipeline/structure/structure_moves.h"

namespace bendloop::pipeline {
namespace {

// By trial: clamps are longer.
struct ClampSettings {
  // [of r_P] Of a straight between two bends.
  double between = 1.0;
  // [of r_P] Of the tube from where an outermost bend begins: flares and nuts are half as long.
  double end = 3.0;
};
constexpr ClampSettings kClamp;

}  // namespace

std::size_t LeastMadeBends(const SurfaceFit& found) {
  const auto& rows = found.tube.program.rows;
  const std::size_t bends = found.tube.program.bend_count();
  const double r_mm = found.tube.pipe_radius_mm;
  std::vector<std::size_t> first;  // of the bends that may be one
  for (std::size_t i = 0; i < bends; ++i) {
    if (i == 0 || rows[i].length_mm > kClamp.between * r_mm) first.push_back(i);
  }
  const double few_samples = kClamp.end * r_mm * UsualSamplesPerMm(found);
  const auto is_at_end = [&](std::size_t from_segment, std::size_t to_segment) {
    double samples = 0;
    for (std::size_t k = from_segment; k < to_segment; ++k) samples += found.segment_samples[k];
    return samples < few_samples;
  };
  std::size_t least = first.size();
  if (least > 0 && is_at_end(2 * first.back() + 1, 2 * bends + 1)) --least;
  if (least > 0 && is_at_end(0, first.size() > 1 ? 2 * first[1] : 2 * bends)) --least;
  return least;
}

}  // namespace bendloop::pipeline
