// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/easing_fit.h"

#include <cmath>

#include "pipeline/fit/surface_sums.h"

namespace bendloop::pipeline {
namespace {

struct EasingSettings {
  // So many points tell whether there is any. By trial.
  std::size_t points = 8000;
  // [of r_P] Where the search begins: benders' clamps and dies make 0.2 to 1.
  double start = 0.3;
  // [sigma] From which on samples insist, as for oval bends.
  double insist = 6.0;
  // Steps, and what they must have gained by then [variances], for more steps. By trial.
  int first_steps = 3;
  double promising = 12.0;
};
constexpr EasingSettings kEasingFit;

double CostOf(const SurfaceFit& fit, double sigma_mm, const SurfaceFitOptions& options) {
  const auto out_of_reach = static_cast<double>(fit.points - fit.distances_mm.size());
  return RobustSum(fit.distances_mm, sigma_mm) +
         out_of_reach * RobustSum(options.reach_mm, sigma_mm) +
         fit.priors.ChiSquare(fit.tube.program, fit.flattening, fit.easing);
}

}  // namespace

Easing FindEasing(const SurfaceFit& structure, std::span<const PointBlock> blocks,
                  SurfaceFitOptions options) {
  const std::size_t bends = structure.tube.program.bend_count();
  if (bends == 0) return {};
  const OwnedBlocks few = Thinned(blocks, StrideTo(CountPoints(blocks), kEasingFit.points));
  options.easing = {};
  const SurfaceFit sharp = FitSurface(structure.tube, few, options);
  const double start_mm = kEasingFit.start * structure.tube.pipe_radius_mm;
  options.easing.variance_mm2.assign(bends, start_mm * start_mm);
  const auto gain = [&](const SurfaceFit& eased) {
    return CostOf(sharp, eased.sigma_mm, options) - CostOf(eased, eased.sigma_mm, options);
  };
  // Most tubes' bends are sharp, and the first steps show it.
  const int most_steps = options.max_steps;
  options.max_steps = kEasingFit.first_steps;
  const SurfaceFit first = FitSurface(sharp.tube, few, options);
  if (gain(first) < kEasingFit.promising * first.design_effect) return {};
  options.max_steps = most_steps;
  options.easing = first.easing;
  const SurfaceFit eased = FitSurface(first.tube, few, options);
  return gain(eased) > kEasingFit.insist * kEasingFit.insist * eased.design_effect ? eased.easing
                                                                                   : Easing{};
}

}  // namespace bendloop::pipeline
