// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/dent_evidence.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "pipeline/fit/bowed_spine.h"
#include "pipeline/fit/design_effect.h"
#include "pipeline/fit/surface_pass.h"

namespace bendloop::pipeline {
namespace {

// [sigma] So far off are points at most that tell of a patch: more is a dent already.
constexpr double kOnTube = 4.0;

// What patches of the surface are off the tube, beyond what noise moves them by [variances].
double PatchesOff(const BowedSolution& solution, std::span<const PointBlock> blocks,
                  double reach_mm) {
  const BowedTubeState& state = solution.bows.state;
  const double noise_mm = solution.bows.noise_mm, r_mm = state.tube.pipe_radius_mm;
  const EasedSpine spine = SpineOf(state);
  const SurfaceAssignment points = PointsOf(state, spine, kBeyond * r_mm, blocks, reach_mm);
  DesignEffect patches;
  patches.Add(points.segments, SegmentFrames(spine, kBeyond * r_mm, state.flattening), r_mm,
              kOnTube * noise_mm);
  return patches.between / (noise_mm * noise_mm) - patches.patches;
}

}  // namespace

double OfDents(const BowedSolution& plain, std::span<const PointBlock> all,
               std::span<const PointBlock> others, double reach_mm) {
  return PatchesOff(plain, all, reach_mm) - PatchesOff(plain, others, reach_mm);
}

double EvidenceOfDents(const BowedSolution& dented, const BowedSolution& plain,
                       std::span<const PointBlock> blocks, double reach_mm) {
  const auto all = plain.undented ? std::span<const PointBlock>(*plain.undented) : blocks;
  const std::span<const PointBlock> others = *dented.undented;
  if (CountPoints(others) >= CountPoints(all)) return -std::numeric_limits<double>::infinity();
  const double of_others = AdvantageAt(others, dented, plain, reach_mm);
  if (of_others < -kDentEvidence.worse) return of_others;
  // What the plain tube leaves of patches a dent of that form explains.
  const double worth = std::max(1.0, std::min(dented.bows.worth, plain.bows.worth));
  const double of_dents = OfDents(plain, all, others, reach_mm) / worth;
  const auto points = static_cast<double>(CountPoints(all) - CountPoints(others));
  return of_others + of_dents - kDentEvidence.numbers * std::log(points);
}

}  // namespace bendloop::pipeline
