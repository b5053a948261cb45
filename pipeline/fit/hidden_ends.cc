// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/hidden_ends.h"

#include "pipeline/fit/bowed_spine.h"

namespace bendloop::pipeline {
namespace {

struct HiddenSettings {
  std::size_t enough_points = 20'000;  // tell where the tube ends
};
constexpr HiddenSettings kHidden;

}  // namespace

std::array<double, 2> HiddenMm(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                               double reach_mm, const BlocksAbout& about) {
  const double r_mm = fit.tube.pipe_radius_mm;
  BowedTubeState state{fit.tube, fit.flattening, fit.easing, {}};
  EndWithPoints(Thinned(blocks, StrideTo(CountPoints(blocks), kHidden.enough_points)), reach_mm,
                {0, 0}, state);
  const EasedSpine spine = SpineOf(state);
  const hal::SpineSegment &first = spine.segments.front(), &last = spine.segments.back();
  const auto hidden_mm = [&](const PlainEnd& end, std::size_t own) {
    return FindFitting(end, r_mm, fit.sigma_mm, about(end, spine, own)).form.length_mm;
  };
  return {hidden_mm({first.start_mm, -first.tangent}, 0),
          hidden_mm({last.PointAt(last.length_mm), last.tangent}, fit.tube.program.bend_count())};
}

}  // namespace bendloop::pipeline
