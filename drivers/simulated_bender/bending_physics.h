// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "hal/bend_program.h"
#include "hal/result.h"

namespace bendloop::drivers {

// What steel does to a program. All 0: the tube is bent as commanded.
struct BendingPhysics {
  double springback_20_deg = 0;   // degrees that a bend of 20 degrees opens again
  double springback_120_deg = 0;  // of 120 degrees; linear in between and beyond
  // Material stretch of an arc in percent of its length; half of it lengthens each neighbouring
  // straight (the arc itself keeps radius and angle of the tool).
  double elongation_percent = 0;
  double twist_deg = 0;           // added to each rotation but the first
  double radius_spring_out = 0;   // part by which a bend radius grows
  double sigma_angle_deg = 0;     // part-to-part scatter, 1 sigma, Gaussian
  double sigma_rotation_deg = 0;  // not of the first rotation
  double sigma_length_mm = 0;
  double default_bend_radius_mm = 0;  // for bends whose program says none
  std::uint64_t seed = 1;
};

// kBadInput: the option, as the command lines name it, whose value no bender has.
hal::Result<void> CheckBendingPhysics(const BendingPhysics& physics);

// The tube that `program` gives as part `serial` (1, 2, ...): depends on nothing else.
hal::BendProgram BendTube(const hal::BendProgram& program, const BendingPhysics& physics,
                          std::uint32_t serial);

// Degrees that a bend of `angle_deg` opens again; 0 for 0.
double SpringbackDeg(const BendingPhysics& physics, double angle_deg);

}  // namespace bendloop::drivers
