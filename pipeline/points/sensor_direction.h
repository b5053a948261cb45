// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

namespace bendloop::pipeline {

// The direction in which a point's sensor stood, or that nothing is known of it, in four bytes:
// octahedral, good to 1e-4 rad. (The unit octahedron |x| + |y| + |z| = 1, its lower half folded
// outwards over the square of the upper one.)
struct SensorDirection {
  static constexpr std::int16_t kUnknown = std::numeric_limits<std::int16_t>::min();
  static constexpr double kOne = 32767;
  std::int16_t a = kUnknown, b = kUnknown;

  bool known() const { return a != kUnknown; }
  bool operator==(const SensorDirection&) const = default;
};

// `to_sensor` of any length; unknown when it is nothing or not finite.
inline SensorDirection PackDirection(const Eigen::Vector3d& to_sensor) {
  const double size = to_sensor.cwiseAbs().sum();
  if (!(size > 0 && size < std::numeric_limits<double>::max())) return {};
  double a = to_sensor.x() / size, b = to_sensor.y() / size;
  if (to_sensor.z() < 0) {
    const double unfolded = a;
    a = std::copysign(1.0 - std::abs(b), a);
    b = std::copysign(1.0 - std::abs(unfolded), b);
  }
  const auto whole = [](double part) {
    return static_cast<std::int16_t>(part * SensorDirection::kOne + std::copysign(0.5, part));
  };
  return {whole(a), whole(b)};
}

// Unit vector of one that is known. Plain numbers, for loops that do several at a time.
struct UnpackedDirection {
  double x, y, z;
};
[[gnu::always_inline]] inline UnpackedDirection UnpackDirection(SensorDirection packed) {
  const double a = packed.a * (1.0 / SensorDirection::kOne);
  const double b = packed.b * (1.0 / SensorDirection::kOne);
  const double z = 1.0 - std::abs(a) - std::abs(b);
  const double folded = z < 0 ? -z : 0.0;
  const double x = a < 0 ? a + folded : a - folded;
  const double y = b < 0 ? b + folded : b - folded;
  const double inverse = 1.0 / std::sqrt(x * x + y * y + z * z);
  return {x * inverse, y * inverse, z * inverse};
}

// Which pass of the scan a point came in shares the four bytes: three bits of each number, which
// leaves the direction good to 3e-4 rad. One that is not known has none.
constexpr unsigned kMostPasses = 64;
inline SensorDirection WithPass(SensorDirection direction, unsigned pass) {
  if (!direction.known()) return direction;
  const auto with = [](std::int16_t number, unsigned bits) {
    const int least = std::numeric_limits<std::int16_t>::min() + 8;  // not that of the unknown
    return static_cast<std::int16_t>((std::max<int>(number, least) & ~7) | static_cast<int>(bits));
  };
  return {with(direction.a, pass >> 3 & 7U), with(direction.b, pass & 7U)};
}
inline unsigned PassOf(SensorDirection direction) {
  return (static_cast<unsigned>(direction.a) & 7U) << 3 | (static_cast<unsigned>(direction.b) & 7U);
}

}  // namespace bendloop::pipeline
