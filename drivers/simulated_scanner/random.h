// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>

namespace bendloop::drivers {

// Seeded random numbers that are the same with every standard library (the distributions of
// <random> are not).
class Random {
 public:
  // `stream` gives independent sequences for one seed, e.g. one a profile.
  explicit Random(std::uint64_t seed, std::uint64_t stream = 0)
      : engine_(Mix(Mix(seed) + stream)) {}

  // [0, 1), 53 bits.
  double Uniform() { return static_cast<double>(engine_() >> 11U) * 0x1.0p-53; }
  double Uniform(double from, double to) { return from + (to - from) * Uniform(); }
  bool Chance(double probability) { return Uniform() < probability; }
  // Standard normal (Box and Muller 1958).
  double Normal() {
    if (has_spare_) {
      has_spare_ = false;
      return spare_;
    }
    const double length = std::sqrt(-2.0 * std::log(1.0 - Uniform()));
    const double angle = 2.0 * std::numbers::pi * Uniform();
    spare_ = length * std::sin(angle);
    has_spare_ = true;
    return length * std::cos(angle);
  }

 private:
  // SplitMix64: neighbouring seeds give unlike engines.
  static std::uint64_t Mix(std::uint64_t x) {
    x += 0x9E3779B97F4A7C15U;
    x = (x ^ (x >> 30U)) * 0xBF58476D1CE4E5B9U;
    x = (x ^ (x >> 27U)) * 0x94D049BB133111EBU;
    return x ^ (x >> 31U);
  }

  std::mt19937_64 engine_;
  double spare_ = 0;
  bool has_spare_ = false;
};

}  // namespace bendloop::drivers
