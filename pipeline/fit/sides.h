// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

namespace bendloop::pipeline {

// What the points on a side of a straight, evenly spread around it with others, have in common.
struct SideMean {
  double points = 0;     // fewer than five tell nothing
  double mean_mm = 0;    // of their distances from the surface
  double noise_mm2 = 0;  // variance of that mean by the noise of the points alone
};

// What is beyond noise of the sides' means, without what moves the straight across or makes it
// thicker [mm^2], as passes of a scan leave it that do not meet; negative where noise was kind.
// None: too few sides tell.
std::optional<double> BeyondNoiseMm2(std::span<const SideMean> sides);

}  // namespace bendloop::pipeline
