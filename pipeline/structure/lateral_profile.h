// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "pipeline/fit/surface_fit.h"

namespace bendloop::pipeline {

// How far the samples of a place, about a pipe radius of the spine long, want it across the fitted
// spine: information * off_mm = pull, in the segment's frame (normal x tangent, normal) [mm].
struct LateralPlace {
  double along_mm = 0;  // on its segment
  double samples = 0;
  Eigen::Matrix2d information = Eigen::Matrix2d::Zero();  // samples in each direction
  Eigen::Vector2d pull = Eigen::Vector2d::Zero();         // mm
};

// Of every segment of the fit's tube: line, arc, ..., line. Samples further than `limit_mm` from
// the surface are left out.
std::vector<std::vector<LateralPlace>> LateralProfile(const SurfaceFit& fit,
                                                      std::span<const PointBlock> blocks,
                                                      double reach_mm, double limit_mm);

// How far the spine lies beside the fitted one, place by place, as all but the worst places show
// it; what noise explains is taken off. Within what a FormDeviation allows by itself.
FormDeviation EstimateForm(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                           double reach_mm, const FormDeviation& most);

}  // namespace bendloop::pipeline
