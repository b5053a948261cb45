// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/round_bends.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "hal/spine.h"
#include "pipeline/fit/dent_evidence.h"
#include "pipeline/fit/surface_form.h"
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
  const std::size_t bends = solution.fit.tube.program.bend_count();
  if (!options.flattened || bends == 0 || solution.bows.worth < kRoundBends.disagree) return;
  SurfaceFitOptions round = options;
  round.flattened = false;
  // Easing, too, may be of dents; without them it is found again.
  round.easing = {};
  BowedSolution other = SolveWithBows(solution.straight, blocks, round);
  if (!other.undented || other.bows.is_lost || other.fit.tube.program.bend_count() != bends) return;
  // It has taken a dent in itself.
  if (other.bows.worth > std::max(kRoundBends.disagree, solution.bows.worth)) return;
  if (LooksSunk(other, blocks, options.reach_mm)) return;
  if (EvidenceOfDents(other, solution, blocks, options.reach_mm) < 0) return;
  round.easing = other.fit.easing;
  options = std::move(round);
  solution = std::move(other);
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
