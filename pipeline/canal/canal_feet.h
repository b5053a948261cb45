// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "pipeline/canal/canal_surface.h"

namespace bendloop::pipeline {

// Feet of the points from nowhere: the nearest of densely sampled spheres, then Newton. Points
// further than `reach` (as a part of the radius there) get `beyond`.
std::vector<CanalFoot> FindFeet(const CanalSurface& surface,
                                std::span<const Eigen::Vector3d> points, double radius_mm,
                                double reach);

}  // namespace bendloop::pipeline
