// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace bendloop::pipeline {

// Parts of the turn about an end.
constexpr std::size_t kEndSectors = 24;
using EndSectors = std::array<bool, kEndSectors>;

inline std::size_t EndSectorOf(double around_rad) {
  const double turn = around_rad / (2.0 * std::numbers::pi);
  const double sector = (turn - std::floor(turn)) * static_cast<double>(kEndSectors);
  return std::min(kEndSectors - 1, static_cast<std::size_t>(sector));
}

}  // namespace bendloop::pipeline
