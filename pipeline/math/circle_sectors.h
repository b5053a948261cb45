// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <numbers>

#include "pipeline/math/simd.h"

namespace bendloop::pipeline {

// Where in the turn (x, y) points, 0..4: on the square around the circle, which is close enough to
// equal parts and needs no arc tangent. (0, 0) points somewhere.
BENDLOOP_LOOP double QuarterTurns(double x, double y) {
  constexpr double kNeverZero = 1e-300;
  const double s = y / (std::abs(x) + std::abs(y) + kNeverZero);  // -1..1 over half a turn
  return x >= 0 ? 1.0 + s : 3.0 - s;
}

// Arc tangent of a quotient of 0 to 1: minimax polynomial, error below 1e-5.
BENDLOOP_LOOP double RoughArcTangent(double q) {
  const double s = q * q;
  return q * (0.999977 +
              s * (-0.332623 + s * (0.193541 + s * (-0.116429 + s * (0.052647 - 0.011719 * s)))));
}

// atan2(y, x) to 1e-5, without a branch.
BENDLOOP_LOOP double RoughTurn(double y, double x) {
  constexpr double kPi = std::numbers::pi;
  const double ax = std::abs(x), ay = std::abs(y);
  const double most = ax > ay ? ax : ay, least = ax > ay ? ay : ax;
  double turn = RoughArcTangent(least / (most > 0 ? most : 1.0));
  turn = ay > ax ? 0.5 * kPi - turn : turn;
  turn = x < 0 ? kPi - turn : turn;
  return y < 0 ? -turn : turn;
}

// Which of kSectors parts of the turn.
template <unsigned kSectors>
unsigned AzimuthSector(double x, double y) {
  return static_cast<unsigned>(QuarterTurns(x, y) * (kSectors / 4)) % kSectors;
}

}  // namespace bendloop::pipeline
