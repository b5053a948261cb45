// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "hal/tube_features.h"
#include "pipeline/features/opening_border.h"
#include "pipeline/features/opening_surroundings.h"

namespace bendloop::pipeline {

// A small piece of the wall: how much of it lies outside of an opening's border and how much
// inside, and how many samples it has outside.
struct WallPatch {
  Eigen::Vector3d point_mm = Eigen::Vector3d::Zero(), normal = Eigen::Vector3d::UnitZ();
  double outside_mm2 = 0, inside_mm2 = 0, samples = 0;
};
// The wall about an opening, a hundred pieces of it at most. `border`, `samples`: in the plane of
// `frame`; these reach as far as `reach_mm` from its middle.
std::vector<WallPatch> PatchesAbout(const LookedAtTube& tube, const hal::SurfaceFrame& frame,
                                    const OpeningBorder& border,
                                    std::span<const Eigen::Vector2d> samples, double reach_mm);

}  // namespace bendloop::pipeline
