// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/hidden_radii.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>

#include "pipeline/fit/one_die.h"
#include "pipeline/fit/usual_bend_radius.h"

namespace bendloop::pipeline {
namespace {

struct HiddenRadiiSettings {
  // [sigma] From the usual one a radius may be that is to be it.
  double may = 4.0;
  // [variances, a bend] By which it may explain the points worse.
  double worse = 6.0;
};
constexpr HiddenRadiiSettings kHiddenRadii;

// The tube with the usual radius where the points know it less well than that, and the one found is
// `least_mm` from it at least; corners stay. None: there is no such bend.
std::optional<hal::Tube> WithUsualRadius(const BowedSolution& solution,
                                         const UsualBendRadius& usual, double least_mm) {
  std::optional<hal::Tube> tube;
  for (std::size_t i = 0; i < solution.fit.tube.program.bend_count(); ++i) {
    const hal::Tube& so_far = tube ? *tube : solution.straight;
    const double sigma_mm = solution.fit.sigma.rows[i].bend_radius_mm.value_or(0.0);
    const double off_mm = std::abs(*so_far.program.rows[i].bend_radius_mm - usual.mean_mm);
    const double may_mm = kHiddenRadii.may * std::hypot(sigma_mm, usual.sigma_mm);
    if (sigma_mm < usual.sigma_mm || off_mm < least_mm || off_mm > may_mm) continue;
    if (auto with = WithBendRadii(so_far, usual.mean_mm, i)) tube = std::move(with);
  }
  return tube;
}

}  // namespace

void TakeUsualWhereHidden(const SurfaceFitOptions& options, BowedSolution& solution) {
  const SurfaceFit& fit = solution.fit;
  if (!solution.undented || solution.bows.is_lost) return;
  SurfaceFitOptions with = options;
  with.priors = fit.priors;
  with.easing = fit.easing;
  auto usual = ExpectedRadius(fit);
  // Before the dent was left out its bend had a radius, which may have been none that others share.
  const bool was_expected = usual.has_value();
  if (!usual) with.priors.bend_radius = usual = FindUsualBendRadius(fit);
  if (!usual) return;
  const auto start = WithUsualRadius(solution, *usual, was_expected ? usual->sigma_mm : 0.0);
  if (!start) return;
  const std::span<const PointBlock> beside = *solution.undented;
  BowedSolution other = SolveWithBows(*start, beside, with);
  if (!IsOfSameBends(other, solution)) return;
  const double worse = AdvantageAt(beside, solution, other, options.reach_mm);
  if (worse > kHiddenRadii.worse * static_cast<double>(fit.tube.program.bend_count())) return;
  if (!other.undented) other.undented = std::move(solution.undented);
  solution = std::move(other);
}

}  // namespace bendloop::pipeline
