// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/round_bends.h"

#include <cstddef>
#include <utility>

#include "pipeline/structure/structure_criterion.h"

namespace bendloop::pipeline {
namespace {

struct RoundBendsSettings {
  // So many tell; and so many whether it is worth a fit of all.
  std::size_t points = 32'000, few_points = 8000;
  // [design effect] From which on a tube of round bends leaves more than noise. By trial: ideal
  // tubes have 1 to 2, and bends 4 % oval at a noise of 0.3 % of r_P hundreds.
  double unexplained = 3.0;
};
constexpr RoundBendsSettings kRoundBends;

}  // namespace

void RoundBendsThatEase(const SurfaceFit& structure, std::span<const PointBlock> blocks,
                        SurfaceFitOptions& options, FoundEasing& found) {
  if (!options.flattened || !found.eased) return;
  SurfaceFitOptions round = options;
  round.flattened = false;
  FoundEasing of_round = FindEasing(structure, blocks, round);
  if (!of_round.eased) return;
  const OwnedBlocks few = Gathered(blocks, StrideTo(CountPoints(blocks), kRoundBends.points));
  const auto fit = [&few](const FoundEasing& of, SurfaceFitOptions with) {
    with.easing = of.easing;
    return FitSurface(*of.eased, few, with);
  };
  const SurfaceFit is_round = fit(of_round, round), is_flattened = fit(found, options);
  if (StructureCriterion(1.0, few.point_count()).IsFlattened(is_round, is_flattened)) return;
  options = std::move(round);
  found = std::move(of_round);
}

void FlattenRoundBends(std::span<const PointBlock> blocks, SurfaceFitOptions& options,
                       BowedSolution& solution) {
  const SurfaceFit& round = solution.fit;
  const std::size_t bends = round.tube.program.bend_count();
  if (options.flattened || bends == 0) return;
  if (round.design_effect < kRoundBends.unexplained) return;
  SurfaceFitOptions flattened = options;
  flattened.flattened = true;
  // Most of what tubes leave is no ovality.
  const OwnedBlocks few = Gathered(blocks, StrideTo(CountPoints(blocks), kRoundBends.few_points));
  const auto of_few = [&](SurfaceFitOptions with) {
    with.easing = round.easing;
    with.report = FitReport::kCost;
    return FitSurface(solution.straight, few, with);
  };
  const SurfaceFit few_flattened = of_few(flattened);
  const double few_mm2 = few_flattened.sigma_mm * few_flattened.sigma_mm;
  const double led = of_few(options).cost_mm2 - few_flattened.cost_mm2;
  if (led < few_mm2 * StructureCriterion::InsistOnFlattened(few_flattened)) return;
  BowedSolution other = SolveAnew(solution.straight, blocks, flattened);
  if (other.fit.tube.program.bend_count() != bends || other.bows.is_lost) return;
  const double variance_mm2 = other.fit.sigma_mm * other.fit.sigma_mm;
  const double asked = StructureCriterion::InsistOnFlattened(other.fit) +
                       StructureCriterion::AsSidesMm2(other.fit) / variance_mm2;
  if (AdvantageOf(other, solution, blocks, options.reach_mm) < asked) return;
  options = std::move(flattened);
  solution = std::move(other);
}

}  // namespace bendloop::pipeline
