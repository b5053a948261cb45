// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "hal/bend_program.h"
#include "hal/pose.h"

namespace bendloop::hal {

// A bent round tube somewhere in the world: what a program makes, where it lies, how thick it is.
struct Tube {
  double pipe_radius_mm = 0;
  BendProgram program;
  Pose X_WT;  // start of the spine; the first straight along +x, the first bend's normal along +z
};

}  // namespace bendloop::hal
