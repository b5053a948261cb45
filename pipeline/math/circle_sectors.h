// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

#include "pipeline/math/simd.h"

namespace bendloop::pipeline {

// Where in the turn (x, y) points, 0..4: on the square around the circle, which is close enough to
// equal parts and needs no arc tangent. (0, 0) points somewhere.
BENDLOOP_LOOP double QuarterTurns(double x, double y) {
  constexpr double kNeverZero = 1e-300;
  const double s = y / (std::abs(x) + std::abs(y) + kNeverZero);  // -1..1 over half a turn
  return x >= 0 ? 1.0 + s : 3.0 - s;
}

// Which of kSectors parts of the turn.
template <unsigned kSectors>
unsigned AzimuthSector(double x, double y) {
  return static_cast<unsigned>(QuarterTurns(x, y) * (kSectors / 4)) % kSectors;
}

}  // namespace bendloop::pipeline
