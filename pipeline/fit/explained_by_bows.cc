// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/explained_by_bows.h"

#include <algorithm>

#include "pipeline/fit/surface_pass.h"

namespace bendloop::pipeline {
namespace {

constexpr std::size_t kEnoughPoints = 20'000;  // for a mean square

double MeanSquareMm2(const BowedTubeState& state, std::span<const PointBlock> blocks,
                     double reach_mm) {
  const SurfaceAssignment points =
      PointsOf(state, SpineOf(state), kBeyond * state.tube.pipe_radius_mm, blocks, reach_mm);
  // Those out of reach are as bad as those that just are not.
  const auto all = static_cast<double>(CountPoints(blocks));
  double sum_mm2 = (all - static_cast<double>(points.distances_mm.size())) * reach_mm * reach_mm;
  for (const SegmentPoints& of : points.segments) {
    for (const double d_mm : of.distance.head(static_cast<Eigen::Index>(of.size))) {
      sum_mm2 += std::min(d_mm * d_mm, reach_mm * reach_mm);
    }
  }
  return all > 0 ? sum_mm2 / all : 0.0;
}

}  // namespace

double ExplainedByBowsMm2(const BowedTubeState& bowed, const hal::Tube& straight,
                          std::span<const PointBlock> blocks, double reach_mm) {
  if (!bowed.is_bowed()) return 0.0;
  const OwnedBlocks points = Thinned(blocks, StrideTo(CountPoints(blocks), kEnoughPoints));
  const BowedTubeState without{straight, bowed.flattening, bowed.easing, {}};
  return std::max(
      0.0, MeanSquareMm2(without, points, reach_mm) - MeanSquareMm2(bowed, points, reach_mm));
}

}  // namespace bendloop::pipeline
