// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/last_fit.h"

#include <utility>

#include "pipeline/fit/die_spread.h"

namespace bendloop::pipeline {
namespace {

struct LastFitSettings {
  // [of what a dent takes of the surface] By trial; where bends are still looked for as much hides
  // them.
  double dents_wide = 1.5;
  // [variances, a bend] By which it may explain the points worse.
  double worse = 6.0;
};
constexpr LastFitSettings kLastFit;

}  // namespace

void FitLast(std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
             BowedSolution& solution) {
  const SurfaceFit& fit = solution.fit;
  if (fit.easing.empty() && !solution.undented) return;
  SurfaceFitOptions last = options;
  last.priors = LearnDieSpread(fit, options.free_pipe_radius);
  last.easing = fit.easing;
  last.dents_wide = kLastFit.dents_wide;
  BowedSolution other = SolveWithBows(solution.straight, blocks, last);
  if (other.fit.tube.program.bend_count() != fit.tube.program.bend_count()) return;
  if (other.bows.is_lost && !solution.bows.is_lost) return;
  // By the points but those of dents, where there are any.
  const double worse = MoreThanDents(solution, other, blocks, options.reach_mm)
                           .value_or(-AdvantageOf(other, solution, blocks, options.reach_mm));
  if (!(worse < kLastFit.worse * static_cast<double>(fit.tube.program.bend_count()))) return;
  solution = std::move(other);
}

}  // namespace bendloop::pipeline
