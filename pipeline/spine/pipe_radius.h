// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

#include "hal/result.h"
#include "pipeline/math/workers.h"

namespace bendloop::pipeline {

// How thick the pipe is, and how sure: from curvature, then refined by cylinders.
struct PipeRadius {
  double radius_mm = 0;
  double sigma_mm = 0;  // standard error of the median
  double noise_mm = 0;  // rms distance of samples from their local cylinder
  double support = 0;   // part of the points tried that agree, 0..1
};

// Finds the pipe radius in points of any scale, clutter included: for rising trial radii, the
// median of 1/kappa_max over the points whose local paraboloid agrees with the trial; then the
// median of free-radius cylinder fits there, which noise does not bias.
// kBadInput: nothing in the points looks like a pipe.
// Source: Bauer & Polthier 2009, section 3.1, with 2 and 3 for the fits.
hal::Result<PipeRadius> EstimatePipeRadius(std::span<const Eigen::Vector3d> points,
                                           Workers* workers = nullptr);

}  // namespace bendloop::pipeline
