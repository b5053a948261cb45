// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

namespace bendloop::pipeline {

// Which of kSectors parts of the turn (x, y) points into: on the square around the circle, which is
// close enough to equal parts and needs no arc tangent.
template <unsigned kSectors>
unsigned TurnSector(double x, double y) {
  const double s = y / (std::abs(x) + std::abs(y));   // -1..1 over half a turn
  const double quarter = x >= 0 ? 1.0 + s : 3.0 - s;  // 0..4 over the turn
  return static_cast<unsigned>(quarter * (kSectors / 4)) % kSectors;
}

}  // namespace bendloop::pipeline
