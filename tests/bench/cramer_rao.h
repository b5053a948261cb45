// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

#include "hal/bend_program.h"
#include "hal/tube.h"

namespace bendloop::bench {

// Least standard deviations, shaped like the tube's values.
struct Bound {
  hal::BendProgram program;
  double pipe_radius_mm = 0;
};

// The least standard deviation that any unbiased estimate of the tube from these points can have:
// the root of the diagonal of the inverse information matrix at the true parameters, for normal
// noise of `noise_mm` along the surface normal, everything unknown (pose, radii, lengths,
// rotations, angles). Points further than 5 sigma and `systematic_mm` from the true surface are
// fliers and tell nothing; of many points a part is taken and stands for all. First and last length
// are bounded by the ends of the scan and not by distances: 0.
Bound CramerRaoBound(const hal::Tube& truth, std::span<const Eigen::Vector3d> points_W,
                     double noise_mm, double systematic_mm = 0);

}  // namespace bendloop::bench
