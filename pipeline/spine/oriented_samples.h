// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "pipeline/points/sample_grid.h"
#include "pipeline/spine/spine_node.h"

namespace bendloop::pipeline {

// A sample that lies on something curved like a pipe, and which way is out.
struct OrientedSample {
  Eigen::Vector3d position_mm;
  Eigen::Vector3d outward;  // unit normal
  Eigen::Vector3d along;    // unit, the direction of the other curvature; sign arbitrary
  double curved_radius_mm;  // 1 / the largest curvature: noisy
};

// Normals of the samples from local paraboloids, whose size follows the local curvature; samples
// whose radius is not within `widest` times `radius_mm` (either way) are left out, and so is what
// is too rough. At most `max_samples`, evenly picked.
std::vector<OrientedSample> OrientSamples(const SampleGrid& grid, double radius_mm, double widest,
                                          std::size_t max_samples);

// Nodes of a spine with varying pipe radius: cylinders of free radius, which start where the
// samples' curvatures lead to. The moving least squares of Bauer & Polthier 2009, section 3, for
// pipes that it does not speak of. `support`: radius of the weights' ball, in local radii.
std::vector<SpineNode> ProjectWithFreeRadius(const SampleGrid& grid,
                                             std::span<const OrientedSample> samples,
                                             double radius_mm, double support);

}  // namespace bendloop::pipeline
