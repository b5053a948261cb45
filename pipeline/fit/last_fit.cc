// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/last_fit.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "pipeline/fit/die_spread.h"

namespace bendloop::pipeline {
namespace {

struct LastFitSettings {
  // [variances, a bend] By which it may explain the points worse.
  double worse = 6.0;
  // [of what was left out] As much more may be: what has lost its way takes for dents what it lost.
  double more_out = 3.0;
};
constexpr LastFitSettings kLastFit;

double LeftOut(const BowedSolution& solution, std::span<const PointBlock> blocks) {
  const std::size_t all = CountPoints(blocks);
  return static_cast<double>(solution.undented ? all - solution.undented->point_count() : 0);
}

// [variances] By the points but those of dents, where there are any.
double WorseBy(const BowedSolution& other, const BowedSolution& solution,
               std::span<const PointBlock> blocks, double reach_mm) {
  if (solution.undented) {
    if (const auto worse = MoreThanDents(solution, other, blocks, reach_mm)) return *worse;
  }
  return -AdvantageOf(other, solution, blocks, reach_mm);
}

}  // namespace

void FitLast(std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
             BowedSolution& solution) {
  const SurfaceFit& fit = solution.fit;
  const std::size_t bends = fit.tube.program.bend_count();
  if (fit.easing.empty() && !solution.undented) return;
  SurfaceFitOptions last = options;
  last.priors = LearnDieSpread(fit, options.free_pipe_radius);
  last.easing = fit.easing;
  last.dents = kWideDentMargin;
  BowedSolution other = SolveWithBows(solution.straight, blocks, last);
  if (other.fit.tube.program.bend_count() != bends) return;
  if (other.bows.is_lost && !solution.bows.is_lost) return;
  // Dents that it has taken in again pull as they did.
  if (solution.undented && !other.undented) return;
  if (LeftOut(other, blocks) > kLastFit.more_out * LeftOut(solution, blocks)) return;
  const double worse = WorseBy(other, solution, blocks, options.reach_mm);
  if (!(worse < kLastFit.worse * static_cast<double>(std::max<std::size_t>(1, bends)))) return;
  solution = std::move(other);
}

}  // namespace bendloop::pipeline
