// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <numbers>

namespace bendloop::hal {

// Angles are degrees where people read or write them, and radians inside.
inline constexpr double kDegreesPerRadian = 180.0 / std::numbers::pi;
inline constexpr double kRadiansPerDegree = std::numbers::pi / 180.0;

}  // namespace bendloop::hal
