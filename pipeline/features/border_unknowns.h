// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

#include "pipeline/features/rational_bezier.h"

namespace bendloop::pipeline {

// A curve as the unknowns of its fit: joints, unit tangents in them (two in a corner), and of each
// piece the logarithms of both handles over `unit_mm` and of both inner weights, the outer being 1.
// G1 holds whatever the unknowns are.
struct BorderUnknowns {
  struct Piece {
    std::size_t start = 0, end = 0;                  // joints
    std::size_t start_tangent = 0, end_tangent = 0;  // both along the curve
    std::array<double, 4> shape{};                   // ln handles, ln inner weights
  };

  std::vector<Eigen::Vector3d> joints_mm;
  std::vector<Eigen::Vector3d> tangents;
  std::vector<Piece> pieces;
  std::vector<bool> corner;
  bool closed = false;
  double unit_mm = 1;

  static BorderUnknowns Of(const RationalBezier& curve);
  RationalBezier Curve() const;
  // Free numbers that change the shape of the curve: a smooth joint's slide along it does not.
  int Parameters() const;
};

}  // namespace bendloop::pipeline
