// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/hidden_ends.h"

#include <vector>

#include "pipeline/fit/bowed_spine.h"
#include "pipeline/fit/end_forms.h"
#include "pipeline/fit/other_parts.h"

namespace bendloop::pipeline {
namespace {

struct HiddenSettings {
  std::size_t enough_points = 20'000;  // tell where the tube ends
};
constexpr HiddenSettings kHidden;

// Blocks about an end, of the straight there alone.
std::vector<PointBlock> BlocksAbout(const PlainEnd& end, const EasedSpine& spine, std::size_t own,
                                    double r_mm, std::span<const PointBlock> blocks) {
  std::vector<PointBlock> about;
  for (const PointBlock& block : blocks) {
    const double near_mm = kEndFormReach * r_mm + block.half_diagonal_mm;
    if ((block.center_mm - end.position_mm).norm() > near_mm) continue;
    if (!IsOfAnotherPart(block, spine, own, r_mm)) about.push_back(block);
  }
  return about;
}

}  // namespace

std::array<double, 2> HiddenMm(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                               double reach_mm) {
  const double r_mm = fit.tube.pipe_radius_mm;
  BowedTubeState state{fit.tube, fit.flattening, fit.easing, {}};
  EndWithPoints(Thinned(blocks, StrideTo(CountPoints(blocks), kHidden.enough_points)), reach_mm,
                {0, 0}, state);
  const EasedSpine spine = SpineOf(state);
  const hal::SpineSegment &first = spine.segments.front(), &last = spine.segments.back();
  const auto hidden_mm = [&](const PlainEnd& end, std::size_t own) {
    const auto about = BlocksAbout(end, spine, own, r_mm, blocks);
    return FindFitting(end, r_mm, fit.sigma_mm, about).form.length_mm;
  };
  return {hidden_mm({first.start_mm, -first.tangent}, 0),
          hidden_mm({last.PointAt(last.length_mm), last.tangent}, fit.tube.program.bend_count())};
}

}  // namespace bendloop::pipeline
