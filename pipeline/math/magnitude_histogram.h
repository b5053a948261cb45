// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace bendloop::pipeline {

// Quantiles of |value| without keeping the values: drawers that are 1/32 of an octave wide,
// between whose limits they are taken to be spread evenly. Good to a few parts in 10000.
class MagnitudeHistogram {
 public:
  void Add(double value) { ++counts_[DrawerOf(value)]; }
  void Add(const MagnitudeHistogram& other) {
    for (std::size_t i = 0; i < kDrawers; ++i) counts_[i] += other.counts_[i];
  }
  void Clear() { counts_.fill(0); }

  std::size_t Count() const {
    std::size_t count = 0;
    for (const std::uint32_t in_drawer : counts_) count += in_drawer;
    return count;
  }

  // Of a function of the magnitudes, taken in the middle of the drawers.
  template <class Function>
  double Sum(Function function) const {
    double sum = 0;
    for (std::size_t i = 0; i < kDrawers; ++i) {
      if (counts_[i] == 0) continue;
      sum += counts_[i] * function(0.5 * (LowerLimit(i) + LowerLimit(i + 1)));
    }
    return sum;
  }

  // The magnitude that `part` (0..1) of the values do not exceed; 0 for none.
  double Quantile(double part) const {
    double left = part * static_cast<double>(Count());
    for (std::size_t i = 0; i < kDrawers; ++i) {
      const auto count = static_cast<double>(counts_[i]);
      if (count > 0 && left <= count) {
        return std::lerp(LowerLimit(i), LowerLimit(i + 1), left / count);
      }
      left -= count;
    }
    return 0;
  }

 private:
  static constexpr int kShift = 52 - 5;                          // leaves five bits of the mantissa
  static constexpr std::size_t kFirst = (1023 - 40) << 5;        // 2^-40; what is less is the same
  static constexpr std::size_t kDrawers = std::size_t{64} << 5;  // up to 2^24

  static std::size_t DrawerOf(double value) {
    const std::size_t key = std::bit_cast<std::uint64_t>(std::abs(value)) >> kShift;
    return std::clamp(key, kFirst, kFirst + kDrawers - 1) - kFirst;
  }
  static double LowerLimit(std::size_t drawer) {
    return std::bit_cast<double>(static_cast<std::uint64_t>(drawer + kFirst) << kShift);
  }

  std::array<std::uint32_t, kDrawers> counts_{};
};

}  // namespace bendloop::pipeline
