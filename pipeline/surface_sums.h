// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "hal/spine.h"

namespace bendloop::pipeline {

// A segment's local state, which its surface depends on: velocity of its start (3), angular
// velocity (3), both in the frame (tangent, normal x tangent, normal), bend radius, pipe radius.
constexpr int kLocalState = 8;
constexpr int kCondensedRow = kLocalState + 1;  // and the residual
using CondensedSum = Eigen::Matrix<double, kCondensedRow, kCondensedRow>;

struct WeightedPoint {
  Eigen::Vector3d point;
  double weight;
};

// Sum over the points of weight * row * row^T, where a row is the derivative of the point's
// distance from the segment's surface by the local state, then that distance.
CondensedSum SumOfRows(const std::vector<WeightedPoint>& points, const hal::SpineSegment& segment,
                       double pipe_radius_mm);

// Sum of weight * distance^2: the last entry of the above alone.
double SumOfSquares(const std::vector<WeightedPoint>& points, const hal::SpineSegment& segment,
                    double pipe_radius_mm);

}  // namespace bendloop::pipeline
