// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <utility>

#include "hal/angles.h"
#include "hal/spine.h"
#include "hal/tube.h"
#include "hal/tube_features.h"
#include "pipeline/tube/representations.h"

namespace bendloop::tests {

// What is cut into `tube`, counted from its other end: a scan may begin at either.
inline hal::TubeFeatures ReversedFeatures(const hal::TubeFeatures& features,
                                          const hal::Tube& tube) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const hal::Tube other = pipeline::ReverseTube(tube);
  const auto back = hal::SpineSegments(other.program, other.X_WT);
  const double length_mm = hal::SpineLength(tube.program);
  hal::TubeFeatures reversed = features;
  const auto turn = [&](double& along_mm, double& around_deg) {
    const hal::SurfaceFrame frame = hal::FrameAt(segments, along_mm, around_deg);
    along_mm = length_mm - along_mm;
    const hal::SurfaceFrame there = hal::FrameAt(back, along_mm, 0);
    around_deg = hal::AroundDeg(there.outward, there.tangent, frame.outward);
    return frame;
  };
  for (hal::WallOpening& opening : reversed.openings) {
    const hal::SurfaceFrame frame = turn(opening.along_mm, opening.around_deg);
    const hal::SurfaceFrame there = hal::FrameAt(back, opening.along_mm, opening.around_deg);
    const double axis = opening.axis_deg * hal::kRadiansPerDegree;
    const Eigen::Vector3d along =
        std::cos(axis) * frame.tangent + std::sin(axis) * frame.sideways();
    opening.axis_deg = std::remainder(
        std::atan2(along.dot(there.sideways()), along.dot(there.tangent)) * hal::kDegreesPerRadian,
        180.0);
    opening.lean_along_deg = -opening.lean_along_deg;
    opening.lean_around_deg = -opening.lean_around_deg;
  }
  for (hal::PressedDent& dent : reversed.dents) turn(dent.along_mm, dent.around_deg);
  double at_start_mm = 0, at_end_mm = length_mm;
  turn(at_start_mm, reversed.first_end.around_deg);
  turn(at_end_mm, reversed.last_end.around_deg);
  std::swap(reversed.first_end, reversed.last_end);
  at_start_mm = 0, at_end_mm = length_mm;
  turn(at_start_mm, reversed.first_edge.wave_around_deg);
  turn(at_end_mm, reversed.last_edge.wave_around_deg);
  std::swap(reversed.first_edge, reversed.last_edge);
  return reversed;
}

}  // namespace bendloop::tests
