// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/easing_fit.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "pipeline/fit/kept_ends.h"
#include "pipeline/fit/surface_sums.h"

namespace bendloop::pipeline {
namespace {

struct EasingSettings {
  // So many points tell whether there is any. By trial.
  std::size_t points = 8000;
  // [of r_P] Where the search begins: benders' clamps and dies make 0.2 to 1.
  double start = 0.3;
  // [sigma] From which on samples insist. Bends of about the same angle hide what they ease over
  // in a wider radius, which is wrong by more than its sigma; easing that is not there costs
  // certainty alone; at 2 tubes with sharp bends are taken for eased ones.
  double insist = 3.0;
  // After the first step: of what it made chi square less by, so much may be left to the sharp
  // tube's where it led well, and so much more is in sight then (0.012 at most over tubes as the
  // paper's, sharp ones and such that ease over 0.1 to 1.5 r_P; 0.047 where many bends hide it in
  // radii of their own from a noise of 0.0016 r_P). [variances] With less in sight there is no
  // easing; nor where a step goes on by less. By trial.
  double well_led = 0.1, further = 0.06, in_sight = 12.0, promising = 6.0;
};
constexpr EasingSettings kEasingFit;

double CostOf(const SurfaceFit& fit, double sigma_mm, const SurfaceFitOptions& options) {
  const auto out_of_reach = static_cast<double>(fit.points - fit.distances_mm.size());
  return RobustSum(fit.distances_mm, sigma_mm) +
         out_of_reach * RobustSum(options.reach_mm, sigma_mm) +
         fit.priors.ChiSquare(fit.tube.program, fit.flattening, fit.easing);
}

}  // namespace

FoundEasing FindEasing(const SurfaceFit& structure, std::span<const PointBlock> blocks,
                       SurfaceFitOptions options) {
  const std::size_t bends = structure.tube.program.bend_count();
  if (bends == 0) return {};
  const std::size_t stride = StrideTo(CountPoints(blocks), kEasingFit.points);
  const OwnedBlocks few = Gathered(blocks, stride);
  options.easing = {};
  // That of the sharp tube goes on where it is of all points.
  if (stride > 1) options.report = FitReport::kCost;
  SurfaceFit sharp = FitSurface(structure.tube, few, options);
  const auto none = [&sharp, stride] {
    return stride > 1 ? FoundEasing{} : FoundEasing{{}, std::move(sharp), std::nullopt};
  };
  const double start_mm = kEasingFit.start * structure.tube.pipe_radius_mm;
  options.easing.variance_mm2.assign(bends, start_mm * start_mm);
  const auto gain = [&](const SurfaceFit& eased) {
    return CostOf(sharp, eased.sigma_mm, options) - CostOf(eased, eased.sigma_mm, options);
  };
  // Most tubes' bends are sharp, and the first steps show it.
  options.report = FitReport::kCost;
  const int most_steps = std::exchange(options.max_steps, 1);
  const SurfaceFit first = FitSurface(sharp.tube, few, options);
  const double led = (first.start_cost_mm2 - first.cost_mm2) / (first.sigma_mm * first.sigma_mm);
  const double gained = gain(first);
  if (gained > -kEasingFit.well_led * led &&
      gained + kEasingFit.further * led < kEasingFit.in_sight * first.design_effect) {
    return none();
  }
  // A step may go too far, and the next ones bring it back: on as long as they gain.
  SurfaceFit eased = first;
  double now = gained, least = 0;
  do {
    const double before = std::min(now, 0.0);
    options.easing = eased.easing;
    eased = FitSurface(eased.tube, few, options);
    now = gain(eased);
    least = kEasingFit.promising * eased.design_effect;
    if (now < before + least) return none();
  } while (now < least);
  options.max_steps = most_steps;
  options.easing = eased.easing;
  eased = FitSurface(eased.tube, few, options);
  if (gain(eased) < kEasingFit.insist * kEasingFit.insist * eased.design_effect) return none();
  ReachTo(EndsOf(structure.tube), eased.tube);
  return {eased.easing, std::nullopt, eased.tube};
}

}  // namespace bendloop::pipeline
