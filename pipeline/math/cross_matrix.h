// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace bendloop::pipeline {

// The matrix whose product with w is v x w.
inline Eigen::Matrix3d CrossMatrix(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

}  // namespace bendloop::pipeline
