// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "hal/result.h"

namespace bendloop::pipeline {

// A facet's plane: normal . x + offset is 0 on it, negative inside.
struct HullPlane {
  Eigen::Vector3d normal;  // unit, outwards
  double offset_mm = 0;
};

// The planes of the convex hull, by Qhull. kBadInput: the points span no body.
hal::Result<std::vector<HullPlane>> ConvexHull(std::span<const Eigen::Vector3d> points_mm);

}  // namespace bendloop::pipeline
