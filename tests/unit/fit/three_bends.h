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

}  // namespace bendloop::pipeline
