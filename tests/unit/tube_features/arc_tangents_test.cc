// SPDX-License-Identifier: Apache-2.0
#include "pipeline/math/arc_tangents.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

TEST(ArcTangents, AreThoseOfTheLibrary) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> any(-10, 10);
  std::vector<double> x = {0, 1, 0, -1, 0, 3, -3, 1e-300, 5}, y = {0, 0, 1, 0, -1, 3, 3, 1, -1e-12};
  for (int i = 0; i < 1000; ++i) {
    x.push_back(any(random));
    y.push_back(any(random));
  }
  const bool fast = uses_avx2;
  for (const bool avx2 : {false, fast}) {
    uses_avx2 = avx2;
    std::vector<double> turn(x.size());
    ArcTangents(y, x, turn);
    for (std::size_t i = 0; i < x.size(); ++i) {
      EXPECT_NEAR(turn[i], std::atan2(y[i], x[i]), 1e-15 * (1 + std::abs(turn[i]))) << i;
    }
  }
  uses_avx2 = fast;
}

}  // namespace
}  // namespace bendloop::pipeline
