// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/round_bends.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>

#include "hal/spine.h"
#include "pipeline/fit/dent_evidence.h"
#include "pipeline/fit/surface_form.h"
#include "pipeline/fit/without_dents.h"
#include "pipeline/structure/structure_criterion.h"

namespace bendloop::pipeline {
namespace {

struct RoundBendsSettings {
  // So many tell; and so many whether it is worth a fit of all.
  std::size_t points = 32'000, few_points = 8000;
  // [design effect] From which on a tube of round bends leaves more than noise. By trial: ideal
  // tubes have 1 to 2, and bends 4 % oval at a noise of 0.3 % of r_P hundreds.
  double unexplained = 3.0;
  // Times that samples of a place are worth less: what a dent has made of flattened bends makes
  // them disagree so much, and chance hardly does.
  double disagree = 1.02;
};
constexpr RoundBendsSettings kRoundBends;

// Whether most bends have a dent in their plane, as walls that sink in look like: those of round
// bends lie aside, and what seems pressed in may be the other side.
bool LooksSunk(const BowedSolution& round, std::span<const PointBlock> blocks, double reach_mm) {
  const BowedTubeState& state = round.bows.state;
  const auto dents = FindForm(state, round.bows.noise_mm, blocks, reach_mm).dents;
  const auto segments = hal::SpineSegments(state.tube.program, state.tube.X_WT);
  const std::size_t bends = state.tube.program.bend_count();
  std::size_t dented = 0;
  for (std::size_t bend = 0; bend < bends; ++bend) {
    const hal::SpineSegment& arc = segments[2 * bend + 1];
    dented += std::any_of(dents.begin(), dents.end(), [&](const DentFound& dent) {
      const Eigen::Vector3d at = arc.axes().transpose() * (dent.position_mm - arc.center_mm());
      // The arc begins at -y.
      const double along_mm = arc.bend_radius_mm * std::atan2(at.x(), -at.y());
      const double out_mm = std::hypot(at.x(), at.y()) - arc.bend_radius_mm;
      return along_mm > 0 && along_mm < arc.length_mm && std::abs(out_mm) > std::abs(at.z());
    });
  }
  return dented > 1 && (dented == bends || (dented > 2 && 2 * dented > bends));
}

// How much the samples must speak for flattened bends [twice the logarithm of the odds].
double AskedForFlattened(const SurfaceFit& flattened) {
  const double variance_mm2 = flattened.sigma_mm * flattened.sigma_mm;
  return StructureCriterion::InsistOnFlattened(flattened) +
         StructureCriterion::AsSidesMm2(flattened) / variance_mm2;
}

// Round bends with dents, if all points speak for them.
std::optional<BowedSolution> WithDents(const BowedSolution& flattened,
                                       std::span<const PointBlock> blocks,
                                       SurfaceFitOptions round) {
  // Easing, too, may be of dents; without them it is found again.
  round.easing = {};
  BowedSolution other = SolveWithBows(flattened.straight, blocks, round);
  if (!other.undented || !IsOfSameBends(other, flattened)) return std::nullopt;
  // It has taken a dent in itself.
  if (other.bows.worth > std::max(kRoundBends.disagree, flattened.bows.worth)) return std::nullopt;
  if (LooksSunk(other, blocks, round.reach_mm)) return std::nullopt;
  if (EvidenceOfDents(other, flattened, blocks, round.reach_mm) < 0) return std::nullopt;
  return other;
}

// Round bends, if the points beside the dents of flattened ones no longer insist on those.
std::optional<BowedSolution> BesideDents(const BowedSolution& flattened,
                                         std::span<const PointBlock> blocks,
                                         SurfaceFitOptions round) {
  const BowedFit& bows = flattened.bows;
  auto undented =
      WithoutDents(bows.state, bows.noise_mm, blocks, blocks, round.reach_mm, kWideDentMargin);
  if (!undented) return std::nullopt;
  const std::span<const PointBlock> beside = *undented;
  round.easing = flattened.fit.easing;
  BowedSolution other = SolveWithBows(flattened.straight, beside, round);
  if (!IsOfSameBends(other, flattened)) return std::nullopt;
  const double advantage = AdvantageAt(beside, flattened, other, round.reach_mm);
  if (advantage > AskedForFlattened(flattened.fit)) return std::nullopt;
  if (!other.undented) other.undented = std::move(undented);
  return other;
}

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

void RoundDentedBends(std::span<const PointBlock> blocks, SurfaceFitOptions& options,
                      BowedSolution& solution) {
  if (!options.flattened || solution.fit.tube.program.bend_count() == 0) return;
  SurfaceFitOptions round = options;
  round.flattened = false;
  std::optional<BowedSolution> other;
  if (solution.bows.worth >= kRoundBends.disagree) other = WithDents(solution, blocks, round);
  if (!other && solution.undented) other = BesideDents(solution, blocks, round);
  if (!other) return;
  round.easing = other->fit.easing;
  options = std::move(round);
  solution = std::move(*other);
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
  if (!IsOfSameBends(other, solution)) return;
  if (AdvantageOf(other, solution, blocks, options.reach_mm) < AskedForFlattened(other.fit)) return;
  options = std::move(flattened);
  solution = std::move(other);
}

}  // namespace bendloop::pipeline
