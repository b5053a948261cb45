// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

#include "hal/spine.h"
#include "hal/tube_features.h"
#include "pipeline/fit/surface_points.h"

namespace bendloop::pipeline {

// The wall about a place, unrolled: x goes along the spine and counts from the tube's start, y
// round the tube from the place, as `frame.sideways()` does there [mm].
class UnrolledWall {
 public:
  // `segments`: another object holds them.
  UnrolledWall(std::span<const hal::SpineSegment> segments, const hal::SurfaceFrame& frame,
               double pipe_radius_mm)
      : segments_(segments), frame_(frame), r_mm_(pipe_radius_mm) {}

  // Of a point whose foot on the segments is known.
  Eigen::Vector2d PlaceOf(const Eigen::Vector3d& point, const SpineFoot& foot) const;
  // On the round surface.
  Eigen::Vector3d PointAt(const Eigen::Vector2d& place_mm) const;

  // How much further along the wall itself a place lies than the frame, which is at `frame_mm` of
  // the spine [mm]: outside a bend the wall is longer than the spine, inside shorter.
  double AlongWallMm(const Eigen::Vector2d& place_mm, double frame_mm) const;
  // Where along the spine that is so at `around_mm` [mm].
  double SpineAtMm(double along_wall_mm, double around_mm, double frame_mm) const;

  // A direction across the tube in the cross-section of another place nearby.
  static Eigen::Vector3d Carried(const Eigen::Vector3d& direction, const Eigen::Vector3d& from,
                                 const Eigen::Vector3d& to);

 private:
  std::span<const hal::SpineSegment> segments_;
  hal::SurfaceFrame frame_;
  double r_mm_;
};

}  // namespace bendloop::pipeline
