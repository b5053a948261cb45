// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

namespace bendloop::pipeline {

// atan2 of many at once, to 1e-15: [radians], (-pi, pi]. All as many. (0, 0) is at 0.
void ArcTangents(std::span<const double> y, std::span<const double> x, std::span<double> turn);

}  // namespace bendloop::pipeline
