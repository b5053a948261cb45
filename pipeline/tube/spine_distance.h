// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "hal/spine.h"

namespace bendloop::pipeline {

// Distance of points from a spine, exact for lines and arcs.
class SpineDistance {
 public:
  // The first and the last straight are extended outwards by `extend_mm`.
  SpineDistance(std::vector<hal::SpineSegment> segments, double extend_mm);

  double operator()(const Eigen::Vector3d& point_mm) const;

 private:
  struct Piece {
    hal::SpineSegment segment;
    Eigen::Vector3d ball_center_mm;  // a ball around the segment, to leave out far ones
    double ball_radius_mm;
  };
  std::vector<Piece> pieces_;
};

}  // namespace bendloop::pipeline
