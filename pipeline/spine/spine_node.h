// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>

namespace bendloop::pipeline {

// A point of the spine, found by projecting samples onto the axis of the cylinder that fits best
// around it.
struct SpineNode {
  Eigen::Vector3d position_mm;
  Eigen::Vector3d tangent;  // unit, sign arbitrary
  double rms_mm = 0;        // of the samples about the cylinder
  std::size_t samples = 0;  // inliers of the cylinder
  double radius_mm = 0;     // of the pipe here; 0: as given, nobody looked
};

}  // namespace bendloop::pipeline
