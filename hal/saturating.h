// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>

namespace bendloop::hal {

// a - b, or the nearest number that there is. For times of devices, which may be any numbers: the
// difference of two that are too far apart stays too large and does not wrap around to a small one.
constexpr std::int64_t SaturatingDifference(std::int64_t a, std::int64_t b) {
  std::int64_t difference = 0;
  if (!__builtin_sub_overflow(a, b, &difference)) return difference;
  return a < b ? std::numeric_limits<std::int64_t>::min()
               : std::numeric_limits<std::int64_t>::max();
}

}  // namespace bendloop::hal
