// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <span>

namespace bendloop::pipeline {

// The surface around a sample as a paraboloid over its estimated tangent plane.
struct LocalParaboloid {
  Eigen::Vector3d foot_mm;  // on the paraboloid, above the sample's place in the plane
  Eigen::Vector3d normal;   // unit, of the paraboloid there; sign arbitrary
  // Eigenvalues [1/mm] and directions of the shape operator G^-1 H; positive curvature bends
  // towards `normal`. |curvature[0]| >= |curvature[1]|.
  std::array<double, 2> curvature{};
  std::array<Eigen::Vector3d, 2> direction{};
  double rms_mm =
      0;  // weighted distance of the samples from the paraboloid along the plane's normal
  std::size_t samples = 0;
};

// Weighted fit to the samples within `radius_mm` of `point`; nothing if they are fewer than 10
// (section 7) or do not span a surface.
// Source: Bauer & Polthier 2009, sections 2.1 and 2.2.
std::optional<LocalParaboloid> FitLocalParaboloid(const Eigen::Vector3d& point,
                                                  std::span<const Eigen::Vector3d> candidates,
                                                  double radius_mm);

}  // namespace bendloop::pipeline
