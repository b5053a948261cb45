// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>

namespace bendloop::pipeline {

// How much shorter the wall is than the spine from one place of a tube to another, on the side
// `outward` [mm]: inside a bend shorter, outside longer. `from`, `to`: the spine's tangents there;
// `outward` is of the cross-section at `from`, as carried there without twist. With t the integral
// of the spine's curvature the wall's length is ds - r dt . outward. Of turns below a half.
inline double ShorterByMm(const Eigen::Vector3d& from, const Eigen::Vector3d& to,
                          const Eigen::Vector3d& outward, double pipe_radius_mm) {
  const Eigen::Vector3d across = to - to.dot(from) * from;
  const double sine = across.norm();
  if (sine == 0) return 0.0;
  return pipe_radius_mm * std::atan2(sine, to.dot(from)) / sine * across.dot(outward);
}

}  // namespace bendloop::pipeline
