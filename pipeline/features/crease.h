// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace bendloop::pipeline {

// The place nearest to `near_mm` where the paraboloids through the points of both sides meet;
// nothing when a side has too few points, when they meet at less than about 10 degrees, or farther
// away than `reach_mm`.
std::optional<Eigen::Vector3d> CreasePlace(const Eigen::Vector3d& near_mm,
                                           const std::vector<Eigen::Vector3d>& one_side_mm,
                                           const std::vector<Eigen::Vector3d>& other_side_mm,
                                           double reach_mm);

}  // namespace bendloop::pipeline
