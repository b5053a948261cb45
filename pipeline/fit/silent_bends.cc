// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/silent_bends.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "pipeline/fit/surface_pass.h"
#include "pipeline/fit/surface_sums.h"
#include "pipeline/points/input_checks.h"

namespace bendloop::pipeline {
namespace {

struct SilentSettings {
  // [of a bend's points within reach] With fewer on the tube the others are not fliers. By trial.
  double say = 0.7;
  double least_points = 30;
  // [sigma] and [of r_P] By which an outer wall stands out.
  double out_sigmas = 6.0, out = 0.003;
  // So many points tell.
  std::size_t enough_points = 40'000;
};
constexpr SilentSettings kSilent;

bool IsSilent(double used, double all) {
  return all > kSilent.least_points && used < kSilent.say * all;
}

// From 0.
std::vector<std::size_t> FindSilentBends(const SurfaceFit& fit, const BowedTubeState& state,
                                         std::span<const PointBlock> blocks, double reach_mm) {
  const std::size_t bends = state.tube.program.bend_count();
  // Beside bows lines and arcs may leave more off.
  bool is_any = false;
  for (std::size_t k = 1; k < std::min(fit.segment_used.size(), fit.segment_samples.size()); ++k) {
    is_any = is_any || IsSilent(fit.segment_used[k], fit.segment_samples[k]);
  }
  if (!is_any) return {};
  const EasedSpine spine = SpineOf(state);
  const OwnedBlocks few = Thinned(blocks, StrideTo(CountPoints(blocks), kSilent.enough_points));
  const SurfaceAssignment points = PointsOf(state, spine, 0.0, few, reach_mm);
  std::vector<double> used(bends, 0.0), all(bends, 0.0);
  for (std::size_t k = 0; k < spine.segments.size(); ++k) {
    if (spine.is_line(k)) continue;
    const SegmentPoints& of = points.segments[k];
    for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(of.size); ++i) {
      all[spine.row(k)] += 1;
      if (std::abs(of.distance[i]) < kNoWeight * fit.sigma_mm) used[spine.row(k)] += 1;
    }
  }
  std::vector<std::size_t> silent;
  for (std::size_t bend = 0; bend < bends; ++bend) {
    if (IsSilent(used[bend], all[bend])) silent.push_back(bend);
  }
  return silent;
}

void SaySilentBends(std::span<const std::size_t> bends, Measurement& measurement) {
  for (const std::size_t bend : bends) {
    measurement.warnings.push_back(
        "many of the points of bend " + std::to_string(bend + 1) +
        " lie a little beside the tube: a tape, a label or a dent may be there; its radius, and "
        "the lengths beside it, may be further off than they say");
  }
}

void SayWallsThatStandOut(Measurement& measurement) {
  const double least_mm = kSilent.out * measurement.tube.pipe_radius_mm;
  for (std::size_t bend = 0; bend < measurement.bend_shapes.size(); ++bend) {
    const BendShape& shape = measurement.bend_shapes[bend];
    const double out_mm = -shape.outer_wall_mm;
    if (!(out_mm > std::max(least_mm, kSilent.out_sigmas * shape.outer_wall_sigma_mm))) continue;
    measurement.warnings.push_back(
        "the outer wall of bend " + std::to_string(bend + 1) + " stands out by " + Mm(out_mm) +
        ", which no bender makes: something may be around it, as a tape or a sleeve; its radius, "
        "and the lengths beside it, may be further off than they say");
  }
}

}  // namespace

void SayWhatIsAroundBends(const SurfaceFit& fit, const BowedTubeState& state,
                          std::span<const PointBlock> blocks, double reach_mm,
                          Measurement& measurement) {
  SaySilentBends(FindSilentBends(fit, state, blocks, reach_mm), measurement);
  SayWallsThatStandOut(measurement);
}

}  // namespace bendloop::pipeline
