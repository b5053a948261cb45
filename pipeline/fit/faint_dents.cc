// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/faint_dents.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "pipeline/fit/dent_evidence.h"
#include "pipeline/fit/die_spread.h"
#include "pipeline/fit/surface_form.h"
#include "pipeline/fit/without_dents.h"

namespace bendloop::pipeline {
namespace {

struct FaintSettings {
  // Times that samples of a place are worth less than independent ones: what a dent has pulled
  // makes them disagree as much, and chance hardly does.
  double disagree = 1.05;
  // Left out about dents.
  DentMargin dents = {.wide = 1.25};
  // Places that are tried.
  std::size_t most = 3;
  // Times that the tube is fitted anew: once that stands a dent is as wide as it is.
  int rounds = 2;
  // [of r_P] From where a bend leaves the most of a dent to its middle; and [of the depth there]
  // how deep it is without the bend's help.
  double near = 2.0, deeper = 1.3;
  // [variances] Which the patches about a place must leave to be looked at: half of what a dent
  // there must explain at least.
  double worth_a_fit = 20.0;
};
constexpr FaintSettings kFaint;

// Fitted to what is `left` about a place, then without those of the dents that this tube shows.
// None: there is no dent.
std::optional<BowedSolution> WithoutDent(std::optional<OwnedBlocks> left,
                                         const BowedSolution& solution,
                                         std::span<const PointBlock> blocks,
                                         std::span<const PointBlock> from,
                                         const SurfaceFitOptions& options) {
  std::optional<BowedSolution> other;
  for (int round = 0; left && left->point_count() < CountPoints(from); ++round) {
    other = SolveWithBows(other ? other->straight : solution.straight, *left, options);
    if (!IsOfSameBends(*other, solution)) return std::nullopt;
    if (!other->undented) other->undented = std::move(left);
    if (round == kFaint.rounds) return other;
    left = WithoutDents(other->bows.state, other->bows.noise_mm, blocks, from, options.reach_mm,
                        kFaint.dents);
  }
  return std::nullopt;
}

// Whether there is clearly a dent, deeper than a bend has left of it.
bool Shows(const BowedSolution& solution, const DentFound& faint,
           std::span<const PointBlock> blocks, double reach_mm) {
  const BowedFit& bows = solution.bows;
  const double near_mm = kFaint.near * bows.state.tube.pipe_radius_mm;
  const auto dents = FindForm(bows.state, bows.noise_mm, blocks, reach_mm).dents;
  return std::any_of(dents.begin(), dents.end(), [&](const DentFound& dent) {
    return (dent.position_mm - faint.position_mm).norm() < near_mm &&
           dent.depth_mm > kFaint.deeper * faint.depth_mm;
  });
}

}  // namespace

void TryFaintDents(std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
                   BowedSolution& solution) {
  if (solution.fit.tube.program.bend_count() == 0 || solution.bows.is_lost ||
      solution.bows.worth < kFaint.disagree) {
    return;
  }
  SurfaceFitOptions without = options;
  without.priors = LearnDieSpread(solution.fit, options.free_pipe_radius);
  without.easing = solution.fit.easing;
  const double reach_mm = options.reach_mm;
  const auto from = solution.undented ? std::span<const PointBlock>(*solution.undented) : blocks;
  auto dents = FaintDents(solution.bows.state, solution.bows.noise_mm, blocks, from, reach_mm);
  dents.resize(std::min(dents.size(), kFaint.most));
  for (const DentFound& dent : dents) {
    OwnedBlocks left = WithoutDentAt(solution.bows.state, dent, from);
    if (OfDents(solution, from, left, reach_mm) < kFaint.worth_a_fit) continue;
    auto other = WithoutDent(std::move(left), solution, blocks, from, without);
    if (!other || !Shows(*other, dent, blocks, reach_mm)) continue;
    if (EvidenceOfDents(*other, solution, blocks, reach_mm) < 0) continue;
    solution = std::move(*other);
    return;
  }
}

}  // namespace bendloop::pipeline
