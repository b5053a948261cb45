// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstdint>
#include <limits>

namespace bendloop::pipeline {

// Whether numbers are multiples of one that stays the same: without a division for each, which
// takes a processor as long as dozens of other instructions.
class DivisibleBy {
 public:
  // `number`: at least 1.
  explicit constexpr DivisibleBy(std::uint64_t number)
      : twos_(std::countr_zero(number)), most_(std::numeric_limits<std::uint64_t>::max() / number) {
    // Newton's iteration modulo 2^64; five correct bits to begin with, twice as many each time.
    const std::uint64_t odd = number >> twos_;
    inverse_ = (3 * odd) ^ 2;
    for (int i = 0; i < 4; ++i) inverse_ *= 2 - odd * inverse_;
  }
  // Of a multiple times the inverse the quotient is left; of all others something larger than any
  // (Granlund and Montgomery 1994, section 9).
  constexpr bool operator()(std::uint64_t value) const {
    return std::rotr(value * inverse_, twos_) <= most_;
  }

 private:
  int twos_;
  std::uint64_t most_, inverse_ = 1;
};

}  // namespace bendloop::pipeline
