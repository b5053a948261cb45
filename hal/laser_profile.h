// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "hal/pose.h"

namespace bendloop::hal {

// A point of the laser line in the sensor frame S, in the laser plane (y = 0) [mm].
// The sensor stands at the origin of S and looks along +z.
struct ProfilePoint {
  float x_mm = 0;
  float z_mm = 0;
};

// One laser line: the points seen at one instant and where the sensor then was.
// The vectors are reserved once at set-up to SourceInfo::max_points; reading into a profile never
// makes them grow past their capacity, so the acquisition path does not allocate.
struct LaserProfile {
  std::uint64_t sequence = 0;  // counts from the scanner, gaps are lost profiles
  std::int64_t t_ns = 0;       // time of exposure on the scanner's clock
  Pose X_WS;                   // sensor to world
  std::vector<ProfilePoint> points;
  std::vector<std::uint8_t> intensity;  // one a point, or empty

  explicit LaserProfile(std::size_t max_points = 0) {
    points.reserve(max_points);
    intensity.reserve(max_points);
  }
};

}  // namespace bendloop::hal
