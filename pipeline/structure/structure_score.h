// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <vector>

#include "pipeline/fit/surface_fit.h"

namespace bendloop::pipeline {

// A place where the samples ask for one bend more.
struct MissingBend {
  std::size_t segment = 0;  // of the tube: line, arc, ..., line
  double along_mm = 0;      // on it
  // What is asked for there, of all that follows: in the world, about the place (axis times angle).
  Eigen::Vector3d turn_rad = Eigen::Vector3d::Zero();
  double stretch_mm = 0;  // and along the tangent; of an arc only
  double gain = 0;        // by which the squared distances would fall, in variances of the noise
};

// The score test: at every place along the spine, how much the squared distances would fall if what
// follows might turn there a little, all parameters of `fit` adjusting themselves. One pass over
// the samples, no fit. Places that stand out among their neighbours, the greatest gain first.
std::vector<MissingBend> FindMissingBends(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                                          double reach_mm);

}  // namespace bendloop::pipeline
