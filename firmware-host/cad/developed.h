// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>

#include "firmware-host/cad/tube_chain.h"

namespace bendloop::host {

// An angle around as it is told: to so many decimals, half a turn is 180 and nothing is -0.
double RoundedTurnDeg(double deg, int decimals);

// A place in the file as it is told: "x 1.0, y 2.0, z 3.0 mm".
std::string FilePlace(const Eigen::Vector3d& p, int decimals = 1);

// The bend that lies at `along_mm` of the developed length, counted from 1; 0: a straight does.
int BendAt(const Spine& spine, double along_mm);

// Where a point is about a centre line.
struct Place {
  double along_mm = 0, across_mm = 0;
  Eigen::Vector3d radial, tangent;  // unit; radial from the centre line to the point
  double around_deg = 0;            // counted as in hal/tube_features.h, (-180, 180]
};

// Places by the developed length of a centre line, which outlives this.
class Developed {
 public:
  explicit Developed(const Spine& spine) : spine_(spine) {}

  // By the nearest point of the centre line.
  Place Of(const Eigen::Vector3d& p) const;

 private:
  const Spine& spine_;
};

}  // namespace bendloop::host
