// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/sunk_ends.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "hal/spine.h"

namespace bendloop::pipeline {
namespace {

struct SunkSettings {
  // [of r_P] and [sigma] A wall is sunk by more than both.
  double least = 0.006, sigmas = 4.0;
  // [of r_P] From the end of the bend: into it, and out of it.
  double into = 0.5, out_of = 1.0;
  // [of r_P] From the spine.
  double most = 1.5;
};
constexpr SunkSettings kSunk;

struct BendEnd {
  Eigen::Vector3d place_mm, beyond, outward, normal;
};

std::vector<BendEnd> SunkEnds(const SurfaceFit& fit) {
  std::vector<BendEnd> ends;
  const auto segments = hal::SpineSegments(fit.tube.program, fit.tube.X_WT);
  for (std::size_t i = 0; i < fit.flattening.size(); ++i) {
    const Flattening& of = fit.flattening[i];
    const double sunk = of.collapse + of.plateau;
    if (sunk < std::max(kSunk.least, kSunk.sigmas * fit.flattening_sigma[i].outer_wall_part)) {
      continue;
    }
    const hal::SpineSegment& bend = segments[2 * i + 1];
    for (const double along_mm : {0.0, bend.length_mm}) {
      const Eigen::Vector3d place_mm = bend.PointAt(along_mm);
      const Eigen::Vector3d tangent = bend.TangentAt(along_mm);
      ends.push_back({place_mm, along_mm > 0 ? tangent : Eigen::Vector3d(-tangent),
                      (place_mm - bend.center_mm()).normalized(), bend.normal});
    }
  }
  return ends;
}

bool IsAbout(const BendEnd& end, const Eigen::Vector3d& point, double r_mm) {
  const Eigen::Vector3d from = point - end.place_mm;
  const double beyond_mm = from.dot(end.beyond), outward_mm = from.dot(end.outward);
  return beyond_mm > -kSunk.into * r_mm && beyond_mm < kSunk.out_of * r_mm && outward_mm > 0 &&
         std::hypot(outward_mm, from.dot(end.normal)) < kSunk.most * r_mm;
}

}  // namespace

std::optional<OwnedBlocks> LeaveOutSunkEnds(std::span<const PointBlock> blocks,
                                            SurfaceFitOptions& options, BowedSolution& solution) {
  if (!options.section_rise.is_none()) return std::nullopt;  // that fits them
  const SurfaceFit& fit = solution.fit;
  const std::vector<BendEnd> ends = SunkEnds(fit);
  if (ends.empty() || solution.bows.is_lost) return std::nullopt;
  const double r_mm = fit.tube.pipe_radius_mm;
  OwnedBlocks left = PointsWithout(blocks, [&](const PointBlock&, const Eigen::Vector3d& point) {
    return std::any_of(ends.begin(), ends.end(),
                       [&](const BendEnd& end) { return IsAbout(end, point, r_mm); });
  });
  const auto solved = [&](bool is_wide) -> std::optional<BowedSolution> {
    SurfaceFitOptions with = options;
    with.wide_plateau = is_wide;
    BowedSolution other = SolveAnew(solution.straight, left, with);
    if (!IsOfSameBends(other, solution) || SunkEnds(other.fit).empty()) return std::nullopt;
    return other;
  };
  auto narrow = solved(false), wide = solved(true);
  if (!narrow && !wide) return std::nullopt;
  options.wide_plateau =
      wide && (!narrow || AdvantageOf(*wide, *narrow, left, options.reach_mm) > 0);
  solution = std::move(options.wide_plateau ? *wide : *narrow);
  return left;
}

}  // namespace bendloop::pipeline
