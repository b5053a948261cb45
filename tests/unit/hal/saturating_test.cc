// SPDX-License-Identifier: Apache-2.0
#include "hal/saturating.h"

#include <gtest/gtest.h>

namespace bendloop::hal {
namespace {

TEST(SaturatingDifference, EndsAtTheLargestAndTheSmallestNumber) {
  EXPECT_EQ(SaturatingDifference(7, 9), -2);
  EXPECT_EQ(SaturatingDifference(INT64_MAX, -1), INT64_MAX);
  EXPECT_EQ(SaturatingDifference(INT64_MAX, INT64_MIN), INT64_MAX);
  EXPECT_EQ(SaturatingDifference(INT64_MIN, 1), INT64_MIN);
  EXPECT_EQ(SaturatingDifference(0, INT64_MIN), INT64_MAX);
  EXPECT_EQ(SaturatingDifference(-1, INT64_MIN), INT64_MAX);
  EXPECT_EQ(SaturatingDifference(INT64_MIN, INT64_MIN), 0);
}

}  // namespace
}  // namespace bendloop::hal
