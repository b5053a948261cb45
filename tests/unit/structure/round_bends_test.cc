// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/round_bends.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/real_tube.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

// The tube fitted with round bends, and asked again whether they are.
struct Asked {
  explicit Asked(const tests::Form& form, const tests::RealScan& scan) {
    const hal::Tube tube = FiveBends();
    std::mt19937_64 random(4);
    const tests::RealCloud cloud = tests::ScanRealTube(tube, form, scan, random);
    const std::vector<PointBlock> blocks = {{Eigen::Vector3d::Zero(), 1e3, cloud.points_W}};
    BowedSolution solution = SolveAnew(tube, blocks, options);
    as_round = solution.fit;
    FlattenRoundBends(blocks, options, solution);
    fit = solution.fit;
  }

  SurfaceFitOptions options{.reach_mm = kReachMm};
  SurfaceFit as_round, fit;
};

TEST(RoundBends, OvalOnesAreFlattenedOnceTheTubeIsKnown) {
  const Asked asked({.bow = 0.002, .easing_r = 0.23, .ovality = 0.041},
                    {.points = 60'000, .noise_mm = 0.01});
  ASSERT_EQ(asked.as_round.easing.variance_mm2.size(), 5u);
  ASSERT_EQ(asked.fit.easing.variance_mm2.size(), 5u);
  EXPECT_GT(asked.as_round.easing.variance_mm2[2], 2 * asked.fit.easing.variance_mm2[2]);
  ASSERT_EQ(asked.fit.flattening.size(), 5u);
  for (const Flattening& of : asked.fit.flattening) EXPECT_NEAR(of.constant, 0.041, 0.02);
  for (std::size_t i = 0; i < 5; ++i) {
    const double sigma_mm = *asked.fit.sigma.rows[i].bend_radius_mm;
    EXPECT_NEAR(*asked.fit.tube.program.rows[i].bend_radius_mm, 19.7, 4 * sigma_mm) << i;
    EXPECT_LT(sigma_mm, 1.0) << i;
  }
}

TEST(RoundBends, RoundOnesStayRound) {
  for (const double drift_mm : {0.0, 0.05}) {
    const Asked asked({.bow = 0.001, .easing_r = 0.4, .dents = {{.along = 0.4, .depth_r = 0.1}}},
                      {.points = 30'000, .noise_mm = 0.01, .drift_mm = drift_mm});
    EXPECT_FALSE(asked.options.flattened) << drift_mm;
  }
}

}  // namespace
}  // namespace bendloop::pipeline
