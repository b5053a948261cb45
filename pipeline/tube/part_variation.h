// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "hal/bend_program.h"

namespace bendloop::pipeline {

// 1 sigma of what may stand between a nominal and a first part bent without any correction:
// springback, stretch, slip.
struct PartVariation {
  double length_mm = 2.0;
  double rotation_deg = 2.0;
  double angle_deg = 3.0;
  double stretch_part = 0.02;     // of the arcs beside a straight, added to its length
  double springback_part = 0.03;  // of a bend's angle
  double radius_part = 0.15;      // of a bend radius
};

// The same for each value of a row of its nominal; the rotation's is that between bends with a
// clear plane.
hal::BendRow ExpectedVariation(const hal::BendProgram& nominal, std::size_t row,
                               const PartVariation& part);

}  // namespace bendloop::pipeline
