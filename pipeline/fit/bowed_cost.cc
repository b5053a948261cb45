// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/bowed_cost.h"

#include "pipeline/fit/surface_pass.h"
#include "pipeline/fit/surface_sums.h"

namespace bendloop::pipeline {

double CostOf(const BowedTubeState& state, std::span<const PointBlock> blocks, double reach_mm,
              double sigma_mm) {
  const SurfaceAssignment points =
      PointsOf(state, SpineOf(state), kBeyond * state.tube.pipe_radius_mm, blocks, reach_mm);
  double cost = static_cast<double>(CountPoints(blocks) - points.distances_mm.size()) *
                RobustSum(reach_mm, sigma_mm);
  for (const SegmentPoints& of : points.segments) {
    cost += RobustSum(std::span(of.distance.data(), of.size), sigma_mm);
  }
  return cost;
}

}  // namespace bendloop::pipeline
