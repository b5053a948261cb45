// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/skewed_easing.h"

#include <utility>

#include "pipeline/fit/easing_fit.h"

namespace bendloop::pipeline {
namespace {

struct SkewSettings {
  std::size_t points = 32'000;  // tell whether it is promising
  // [variances] For each bend, beyond what chance gives it, and for all. By trial: what bows and
  // dents leave beside bends that rise as they fall looked like up to 49 of them, such as do not
  // like 116 and more.
  double by_chance = 1.0, insist = 60.0;
  // Times that samples of a place are worth less where they disagree, as they do where bends rise
  // otherwise than they fall; and [of that] how much must be left at most.
  double disagree = 1.5, left = 0.75;
};
constexpr SkewSettings kSkew;

}  // namespace

void TrySkewedEasing(std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
                     BowedSolution& solution) {
  const std::size_t bends = solution.fit.tube.program.bend_count();
  const double worth = solution.bows.worth;
  if (solution.fit.easing.empty() || solution.bows.is_lost || worth < kSkew.disagree) return;
  const auto fitted = solution.undented ? std::span<const PointBlock>(*solution.undented) : blocks;
  const OwnedBlocks few = Gathered(fitted, StrideTo(CountPoints(fitted), kSkew.points));
  SurfaceFitOptions with = options;
  with.report = FitReport::kCost;
  with.easing = solution.fit.easing;
  const SurfaceFit even = FitSurface(solution.fit.tube, few, with);
  with.easing = even.easing;
  with.easing.skew.assign(bends, 0.0);
  const SurfaceFit skewed = FitSurface(even.tube, few, with);
  const double least = kSkew.insist + kSkew.by_chance * static_cast<double>(bends);
  if (GainOf(skewed, even, with) < least * skewed.design_effect) return;
  with.report = options.report;
  with.easing = skewed.easing;
  BowedSolution other = SolveWithBows(skewed.tube, blocks, with);
  if (!IsOfSameBends(other, solution)) return;
  if (other.bows.worth > kSkew.left * worth) return;
  if (AdvantageOf(other, solution, blocks, options.reach_mm) < least) return;
  solution = std::move(other);
}

}  // namespace bendloop::pipeline
