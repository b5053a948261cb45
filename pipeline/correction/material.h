// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "hal/bend_program.h"
#include "hal/result.h"

namespace bendloop::pipeline {

// How a tube answers the bender. Springback is linear in the commanded angle c, given at two
// angles as setters enter it:
//   angle after = c - springback(c)
// Elongation: a bend stretches its arc; the stretch of `elongation_percent` of the finished arc's
// length (bend radius x angle after) shows half in the straight before and half in the one after.
struct Material {
  double springback_at_20_deg = 0;   // [deg]
  double springback_at_120_deg = 0;  // [deg]
  double elongation_percent = 0;

  double SpringbackDeg(double commanded_deg) const;
  // d (angle after) / d (angle commanded).
  double AngleSlope() const { return 1.0 - (springback_at_120_deg - springback_at_20_deg) / 100.0; }
  double AngleAfterDeg(double commanded_deg) const;
  double AngleToCommandDeg(double wanted_deg) const;
  // Added to each of the two straights beside a finished bend [mm].
  double StretchOfStraightMm(double bend_radius_mm, double angle_after_deg) const;

  bool operator==(const Material&) const = default;
};

// kBadInput for a material that no bender could bend (slope outside 0.5..1.5, springback above 45
// degrees, elongation outside -5..25 %).
hal::Result<void> Check(const Material& material);

// What `commanded` becomes.
hal::BendProgram PredictBent(const hal::BendProgram& commanded, const Material& material);

// The first program for a nominal: the inverse of PredictBent. A straight too short to hold its
// stretch is commanded as 0. kBadInput when an angle would not be positive.
hal::Result<hal::BendProgram> InitialProgram(const hal::BendProgram& nominal,
                                             const Material& material);

}  // namespace bendloop::pipeline
