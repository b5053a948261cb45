// SPDX-License-Identifier: Apache-2.0
#include "pipeline/math/divisible_by.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <random>

namespace bendloop::pipeline {
namespace {

TEST(DivisibleBy, SaysWhatADivisionSays) {
  std::mt19937_64 random(1);
  for (std::uint64_t number = 1; number < 1000; ++number) {
    const DivisibleBy is_multiple(number);
    EXPECT_TRUE(is_multiple(0)) << number;
    for (int i = 0; i < 20; ++i) {
      const std::uint64_t any = random() >> (i % 40), multiple = any / number * number;
      EXPECT_EQ(is_multiple(any), any % number == 0) << any << " by " << number;
      EXPECT_TRUE(is_multiple(multiple)) << multiple << " by " << number;
    }
  }
}

}  // namespace
}  // namespace bendloop::pipeline
