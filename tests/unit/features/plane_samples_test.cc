// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/plane_samples.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace bendloop::pipeline {
namespace {

double NearestOfAll(const Eigen::Vector2d& place, const std::vector<Eigen::Vector2d>& samples) {
  double nearest = 1e300;
  for (const auto& sample : samples) nearest = std::min(nearest, (sample - place).squaredNorm());
  return std::sqrt(nearest);
}

TEST(PlaneSamples, AreAsNearAsALookAtAllOfThemSays) {
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    // Long and thin, on a line, with fliers, or all in one place; with places beside them all.
    const double width_mm = std::pow(10.0, uniform(random)), thin = seed % 4 == 0 ? 0.0 : 0.3;
    std::vector<Eigen::Vector2d> samples(1 + seed * 7);
    for (auto& sample : samples) {
      sample = {width_mm * uniform(random), thin * width_mm * uniform(random)};
    }
    if (seed % 5 == 1) samples.emplace_back(1e4 * width_mm, -3e3 * width_mm);
    if (seed % 7 == 3) samples.assign(samples.size(), samples.front());
    const PlaneSamples cells(samples);
    for (int i = 0; i < 100; ++i) {
      const Eigen::Vector2d place(3.0 * width_mm * uniform(random),
                                  3.0 * width_mm * uniform(random));
      EXPECT_EQ(cells.NearestMm(place), NearestOfAll(place, samples));
    }
  }
}

TEST(PlaneSamples, AreFarAwayWhereThereAreNone) {
  EXPECT_GT(PlaneSamples({}).NearestMm({1.0, 2.0}), 1e100);
}

}  // namespace
}  // namespace bendloop::pipeline
