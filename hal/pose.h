// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace bendloop::hal {

// A rigid motion X_AB: a point p_B in frame B is `orientation * p_B + position_mm` in frame A.
// Frames: S sensor, W world (arm base), T tube (first straight along +x, first bend in the xy
// plane).
struct Pose {
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();  // unit

  Eigen::Vector3d operator*(const Eigen::Vector3d& p_B) const {
    return orientation * p_B + position_mm;
  }
  Pose operator*(const Pose& X_BC) const {
    return {orientation * X_BC.position_mm + position_mm,
            (orientation * X_BC.orientation).normalized()};
  }
  Pose Inverse() const {
    const Eigen::Quaterniond inverse = orientation.conjugate();
    return {inverse * -position_mm, inverse};
  }
};

}  // namespace bendloop::hal
