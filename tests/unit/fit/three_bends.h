// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "hal/clock.h"
#include "hal/tube.h"

namespace bendloop::pipeline {

inline const hal::SteadyClock kClock;
inline constexpr double kReachMm = 1.0;  // of fits

// A tube of 5 mm with three bends and straights of 6 to 10 radii.
inline hal::Tube ThreeBends() {
  hal::Tube tube;
  tube.pipe_radius_mm = 5;
  tube.program.rows = {{45, 0, 60, 15}, {55, 80, 35, 12}, {40, -120, 90, 17}, {50, 0, 0, {}}};
  tube.X_WT.position_mm = {10, -20, 30};
  return tube;
}

// The same pipe with five bends of one die, one of them slight.
inline hal::Tube FiveBends() {
  hal::Tube tube = ThreeBends();
  tube.program.rows = {{57, 0, 61, 19.7},   {48, -134, 30, 19.7}, {47, -5, 86, 19.7},
                       {66, 135, 16, 19.7}, {57, 119, 24, 19.7},  {68, 0, 0, {}}};
  return tube;
}

}  // namespace bendloop::pipeline
