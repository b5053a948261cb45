// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "hal/pose.h"
#include "hal/spine.h"

namespace bendloop::drivers {

// How the sensor is moved along a tube.
struct ScanPathOptions {
  // One pass along the tube for each: the side it is seen from, as the angle about the tube's
  // direction, 0 is as near to `up` as the tube allows.
  std::vector<double> views_deg = {0};
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();  // in W
  double standoff_mm = 150;                       // from the spine
  double profile_spacing_mm = 1;                  // along the spine
  double overrun_mm = 8;                          // before the start and after the end of the tube
  bool reverse = false;                           // begins at the tube's end
  // A hand that is not steady: slow swings, 1 sigma of each axis.
  double jitter_mm = 0;
  double jitter_deg = 0;
};

// Evenly spread view angles: within 70 degrees of the upside, or all around.
std::vector<double> SpreadViewsDeg(int count, bool all_around = false);

// X_WS for each profile: the sensor stands off the spine and looks at it; the laser plane is
// perpendicular to the spine (when the hand is steady), y of S is against the spine's direction.
std::vector<hal::Pose> ScanPath(const std::vector<hal::SpineSegment>& spine,
                                const ScanPathOptions& options, std::uint64_t seed);

}  // namespace bendloop::drivers
