// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "pipeline/canal/canal_surface.h"

namespace bendloop::pipeline {

struct CanalFitOptions {
  bool varying_radius = true;
  double radius_mm = 0;  // about the pipe's; the unit of knot spacing and reach
};

struct CanalFit {
  CanalSurface surface;
  double sigma_mm = 0;   // robust standard deviation of the distances
  double cost_mm2 = 0;   // sum over all points of min(d^2, reach^2)
  double criterion = 0;  // Bayesian information criterion, comparable between fits
  int parameters = 0;
  std::size_t used = 0;
  double pipe_radius_sigma_mm = 0;  // of the local radius, median along the spine
  double spine_sigma_mm = 0;        // of a point of the spine, across it; median
  // Variance of the spine over what it would be if the radius were known: about 1 when the samples
  // surround the pipe, large when they lie on one side and thickness and place look the same.
  double radius_inflation = 1;
};

// Least squares of the distance of the points from a canal surface: the knots as dense as the
// points pay for (Bayesian information criterion, from 8 pipe radii down to a half), weights that
// fade out towards 5 sigma. `spine`: (x, y, z, radius) along the spine, ends included.
// The distance min over t of |P - C(t)| - r(t) is exact, and so are its derivatives, because at the
// minimum the parameter does not matter.
CanalFit FitCanal(std::span<const Eigen::Vector4d> spine, std::span<const Eigen::Vector3d> points,
                  const CanalFitOptions& options);

}  // namespace bendloop::pipeline
