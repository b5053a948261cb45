// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/bowed_fit.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "pipeline/fit/bowed_cost.h"
#include "pipeline/fit/bowed_tube.h"

namespace bendloop::pipeline {
namespace {

// Whether the samples insist that the straights of `tube`, which takes them, bow; solved with bows
// where they do, else without. Of what they are worth beside bows: as if straights did not bow,
// places would disagree by all of these, and no sample say much.
bool Insists(BowedTube& tube) {
  tube.Solve(true);
  const double left = tube.Left(), worth = tube.worth();
  tube.Solve(false);
  const double freedom = static_cast<double>(kBowModes * tube.bows());
  const double more = (tube.Left() - left) / worth;
  if (!(more > freedom + kBowed.insist * std::sqrt(2.0 * freedom))) return false;
  tube.Solve(true);
  return true;
}

// How many of the points show whether straights bow: what few do not show may still be many times
// what all say that they know.
struct Look {
  std::size_t seen = 0;
  bool insists = false;
};
Look LookForBows(std::span<const PointBlock> blocks, const OwnedBlocks& few, double sigma_mm,
                 BowedTube& straight) {
  straight.Take(few, sigma_mm);
  const Look first{few.point_count(), Insists(straight)};
  const std::size_t points = CountPoints(blocks);
  if (first.insists || points == first.seen) return first;
  const OwnedBlocks many = Thinned(blocks, StrideTo(points, kBowed.many_points));
  straight.Take(many, sigma_mm);
  return {many.point_count(), Insists(straight)};
}

// Whether so few of the `points` have a say that `bowed` lies beside much of the tube. `had_say`:
// of them by lines and arcs alone, `no_bows`; `few`: that tell which of the two is better.
bool HasLostItsWay(const BowedTube& bowed, const OwnedBlocks& points, double had_say,
                   const BowedTubeState& no_bows, const OwnedBlocks& few, double reach_mm) {
  const double has_say = bowed.Weight() / static_cast<double>(points.point_count());
  if (has_say >= kBowed.kept * had_say) return false;
  if (has_say < kBowed.kept_beside_dents * had_say) return true;
  const double noise_mm = bowed.noise_mm();
  return CostOf(bowed.Next(), few, reach_mm, noise_mm) > CostOf(no_bows, few, reach_mm, noise_mm);
}

// Without bows: bends that ease into the middle of a straight turn its best-fit line all the same.
void MoveToLines(const SurfaceFit& before, BowedTubeState state, std::span<const PointBlock> few,
                 const SurfaceFitOptions& options, SurfaceFit& fit) {
  EndWithPoints(few, options.reach_mm, options.hidden_mm, state);
  BowedTube(before, std::move(state), std::nullopt, options).MoveToLines(fit);
}

}  // namespace

BowedFit FitBows(std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
                 SurfaceFit& fit, const BowedFit* from) {
  const BowedTubeState no_bows{fit.tube, fit.flattening, fit.easing, {}};
  if (!HasCorners(fit.tube.program) || fit.tube.program.bend_count() == 0) {
    return {no_bows, fit.sigma_mm, fit.design_effect, true};
  }
  const std::size_t points = CountPoints(blocks);
  const OwnedBlocks few = Thinned(blocks, StrideTo(points, kBowed.few_points));
  const SurfaceFit before = fit;
  BowedTube straight(before, no_bows, std::nullopt, options);
  const auto [seen, insists] = LookForBows(blocks, few, fit.sigma_mm, straight);
  if (!insists) {
    straight.Doubt(false, fit);
    if (!fit.easing.empty()) MoveToLines(before, no_bows, few, options, fit);
    return {no_bows, straight.noise_mm(), straight.worth(), straight.IsPulledAside()};
  }
  const OwnedBlocks enough = Thinned(blocks, StrideTo(points, kBowed.enough_points));
  BowedFit bows{straight.Next(),
                std::hypot(straight.noise_mm(), kBowed.wide * straight.HighestBow()),
                straight.worth(), true};
  if (from && !from->is_lost) bows = *from;
  std::optional<double> usual_radius_mm = straight.UsualRadius();
  const double had_say = straight.Weight() / static_cast<double>(seen);
  bool is_last = false;
  int last_rounds = 0;
  for (int round = 1;; ++round) {
    EndWithPoints(few, options.reach_mm, options.hidden_mm, bows.state);
    BowedTube bowed(before, std::move(bows.state), usual_radius_mm, options);
    const OwnedBlocks& points_now = is_last ? enough : few;
    bowed.Take(points_now, bows.noise_mm);
    bowed.Solve(true);
    // Each step is linear: where another one still explains something it has not arrived, and along
    // what the samples hardly tell apart (radius, easing and bows of a slight bend) that is far.
    const bool is_there =
        is_last && (++last_rounds == kBowed.most_last_rounds || bowed.Gain() < kBowed.at_rest);
    const bool is_lost =
        is_last && HasLostItsWay(bowed, points_now, had_say, no_bows, few, options.reach_mm);
    if (!bowed.IsSolved() || is_lost || round - last_rounds > kBowed.most_rounds ||
        (is_there && !(bowed.IsSettled() && bowed.MoveTo(fit)))) {
      // A radius that bows beside a slight bend made wide is as unsure as it is unusual.
      BowedTube doubtful(before, no_bows, straight.UsualRadius(), options);
      doubtful.Take(few, fit.sigma_mm);
      doubtful.Solve(true);
      doubtful.Doubt(true, fit);
      return {no_bows, doubtful.noise_mm(), doubtful.worth(), true, true};
    }
    const double noise_mm = std::max(
        {options.min_sigma_mm, bowed.noise_mm(), is_last ? 0.0 : kBowed.narrower * bows.noise_mm});
    bows = {bowed.Next(), noise_mm, bowed.worth(), bowed.IsPulledAside()};
    if (is_there) return bows;
    usual_radius_mm = bowed.UsualRadius();
    is_last = is_last || (round >= kBowed.least_rounds - 1 && bowed.IsSettled());
  }
}

}  // namespace bendloop::pipeline
