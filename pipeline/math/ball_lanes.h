// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>

namespace bendloop::pipeline {

// Arrays of coordinates; another object holds them.
struct CoordinateLanes {
  double *x, *y, *z;
};

// Puts p = scale * (point - center) of those points where |p| < 1 into the arrays, in their order;
// each array has room for all points. How many they are. The same to the bit on any processor.
std::size_t GatherInBall(std::span<const Eigen::Vector3d> points, const Eigen::Vector3d& center,
                         double scale, const CoordinateLanes& to);

}  // namespace bendloop::pipeline
