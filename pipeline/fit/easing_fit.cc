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
  // So many points tell whether there is any, and where they leave it open, so many. By trial.
  std::size_t points = 8000, many_points = 32'000;
  // [of r_P] Where the search begins: benders' clamps and dies make 0.2 to 1.
  double start = 0.3;
  // [sigma] From which on samples insist. Bends of about the same angle hide what they ease over
  // in a wider radius, which is wrong by more than its sigma; easing that is not there costs
  // certainty alone; at 2 tubes with sharp bends are taken for eased ones.
  double insist = 3.0;
  // After the first step: of what it made chi square less by, so much may be left to the sharp
  // tube's where it led well, and so much more is in sight then (0.012 at most over tubes as the
  // paper's, sharp ones and such that ease over 0.1 to 1.5 r_P; 0.047 where many bends hide it in
  // radii of their own from a noise of 0.0016 r_P, up to 0.15, mostly less than 0.1, where slight
  // bends do). [variances] With less in sight there is no easing; nor where a step goes on by
  // less. By trial.
  double well_led = 0.1, further = 0.1, in_sight = 12.0, promising = 6.0;
  double hardly = 1.5;  // [of the design effect] The tube follows its samples hardly
};
constexpr EasingSettings kEasingFit;

double CostOf(const SurfaceFit& fit, double sigma_mm, const SurfaceFitOptions& options) {
  const auto out_of_reach = static_cast<double>(fit.points - fit.distances_mm.size());
  return RobustSum(fit.distances_mm, sigma_mm) +
         out_of_reach * RobustSum(options.reach_mm, sigma_mm) +
         fit.priors.ChiSquare(fit.tube.program, fit.flattening, fit.easing);
}

double AskedOf(const SurfaceFit& eased) {
  return kEasingFit.insist * kEasingFit.insist * eased.design_effect;
}

// By many points; few left it open. None: those do not insist.
std::optional<SurfaceFit> EasedByMany(const SurfaceFit& sharp_by_few,
                                      const SurfaceFit& eased_by_few,
                                      std::span<const PointBlock> blocks,
                                      SurfaceFitOptions options) {
  const OwnedBlocks many = Gathered(blocks, StrideTo(CountPoints(blocks), kEasingFit.many_points));
  options.easing = {};
  const SurfaceFit sharp = FitSurface(sharp_by_few.tube, many, options);
  options.easing = eased_by_few.easing;
  SurfaceFit eased = FitSurface(eased_by_few.tube, many, options);
  if (GainOf(eased, sharp, options) < AskedOf(eased)) return std::nullopt;
  return eased;
}

// By steps of the fit from `options.easing` on, as far as easing is in sight. Most tubes' bends are
// sharp, and the first steps show it. `more`: as many times the points may be asked.
std::optional<SurfaceFit> BeginEasing(const SurfaceFit& sharp, const OwnedBlocks& few, double more,
                                      SurfaceFitOptions options) {
  options.max_steps = 1;
  const SurfaceFit first = FitSurface(sharp.tube, few, options);
  const double led = (first.start_cost_mm2 - first.cost_mm2) / (first.sigma_mm * first.sigma_mm);
  const double gained = GainOf(first, sharp, options);
  if (gained > -kEasingFit.well_led * led &&
      gained + kEasingFit.further * led < kEasingFit.in_sight * first.design_effect) {
    return std::nullopt;
  }
  // Where the tube hardly follows its samples a step may go too far, and the next ones bring it
  // back: on as long as they gain.
  SurfaceFit eased = first;
  double now = gained, least = 0;
  do {
    const double before = std::min(now, 0.0);
    options.easing = eased.easing;
    eased = FitSurface(eased.tube, few, options);
    now = GainOf(eased, sharp, options);
    least = kEasingFit.promising / more * eased.design_effect;
    if (now < least && first.design_effect < kEasingFit.hardly) return std::nullopt;
    if (now < before + least) return std::nullopt;
  } while (now < least);
  return eased;
}

}  // namespace

double GainOf(const SurfaceFit& a, const SurfaceFit& b, const SurfaceFitOptions& options) {
  return CostOf(b, a.sigma_mm, options) - CostOf(a, a.sigma_mm, options);
}

FoundEasing FindEasing(const SurfaceFit& structure, std::span<const PointBlock> blocks,
                       SurfaceFitOptions options) {
  const std::size_t bends = structure.tube.program.bend_count();
  if (bends == 0) return {};
  const std::size_t points = CountPoints(blocks);
  const std::size_t stride = StrideTo(points, kEasingFit.points);
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
  // As many times as there are to be asked.
  const double more = static_cast<double>(std::min(points, kEasingFit.many_points)) /
                      static_cast<double>(few.point_count());
  options.report = FitReport::kCost;
  SurfaceFit eased;
  if (options.flattened) {
    // What the first steps leave of the bends' sections hides easing, and looks like it.
    eased = FitSurface(sharp.tube, few, options);
  } else if (auto begun = BeginEasing(sharp, few, more, options)) {
    options.easing = begun->easing;
    eased = FitSurface(begun->tube, few, options);
  } else {
    return none();
  }
  if (const double gain = GainOf(eased, sharp, options); gain < AskedOf(eased)) {
    if (gain * more < AskedOf(eased)) return none();
    auto by_many = EasedByMany(sharp, eased, blocks, options);
    if (!by_many) return none();
    eased = std::move(*by_many);
  }
  ReachTo(EndsOf(structure.tube), eased.tube);
  return {eased.easing, std::nullopt, eased.tube};
}

}  // namespace bendloop::pipeline
