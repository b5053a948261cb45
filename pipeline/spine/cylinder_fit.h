// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

namespace bendloop::pipeline {

// The piece of a cylinder that fits best around a point of the spine.
struct LocalCylinder {
  Eigen::Vector3d point_mm;  // on the axis: the spine sample
  Eigen::Vector3d axis;      // unit, the tangent of the spine; sign as in the initial guess
  double radius_mm = 0;
  double rms_mm = 0;            // weighted, inliers only
  double angular_coverage = 0;  // part of the circumference that has inliers, 0..1
  double axial_spread_mm = 0;   // weighted standard deviation of the inliers along the axis
  std::size_t inliers = 0;
};

struct CylinderFitOptions {
  double radius_mm = 0;  // fixed radius, or the guess when it is free
  bool free_radius = false;
  double support_mm = 0;  // radius of the weight function's ball around the axis point
  double inlier_mm = 0;   // Tukey's cut-off for distances from the surface
  int max_iterations = 12;
  double tolerance = 1e-6;  // of the radius: a shorter step is the last
};

// Weighted least-squares distance fit with weights centred on the axis, where the point's
// projection moves while the axis does (moving least squares). `point` and `axis` are the first
// guess. Nothing if the samples do not determine a cylinder near the guess.
// Source: Bauer & Polthier 2009, section 3 (projection steps ii and iii).
std::optional<LocalCylinder> FitCylinder(const Eigen::Vector3d& point, const Eigen::Vector3d& axis,
                                         std::span<const Eigen::Vector3d> candidates,
                                         const CylinderFitOptions& options);

}  // namespace bendloop::pipeline
