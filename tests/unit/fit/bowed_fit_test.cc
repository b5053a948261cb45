// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/bowed_fit.h"

#include <gtest/gtest.h>

#include <cmath>

#include "pipeline/reconstruction.h"
#include "tests/support/real_tube.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

// As ends are seen by where points stop, they are left out.
TEST(BowedFit, RowsOfBowedTubesAreThoseOfTheBestFitLines) {
  for (const double bow : {1.0 / 1000, 1.0 / 300}) {
    SCOPED_TRACE(bow);
    std::mt19937_64 random(7);
    const auto cloud =
        tests::ScanRealTube(ThreeBends(), {.bow = bow, .s_bow = 0.3 * bow}, {}, random);
    const auto found = Reconstruct(cloud.points_W, {}, kClock);
    ASSERT_TRUE(found) << found.error().message;
    const auto& rows = found->tube.program.rows;
    ASSERT_EQ(rows.size(), 4U);
    const bool reversed = std::abs(rows[0].angle_deg - 60) > 5;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::size_t k = reversed ? 2 - i : i;
      const auto& was = cloud.truth.program.rows[i];
      const auto& sigma = found->sigma.rows[k];
      EXPECT_LT(std::abs(*rows[k].bend_radius_mm - *was.bend_radius_mm), 4 * *sigma.bend_radius_mm);
      EXPECT_LT(std::abs(rows[k].angle_deg - was.angle_deg), 4 * sigma.angle_deg);
      // Lines and arcs alone leave a tenth of a degree and more at L/300.
      EXPECT_LT(sigma.angle_deg, 0.05);
      if (i == 0) continue;
      const std::size_t row = reversed ? 3 - i : i;
      EXPECT_LT(std::abs(rows[row].length_mm - was.length_mm),
                4 * found->sigma.rows[row].length_mm);
      EXPECT_LT(std::abs(hal::WrapRotationDeg(rows[row].rotation_deg - was.rotation_deg)),
                4 * found->sigma.rows[row].rotation_deg);
    }
  }
}

TEST(BowedFit, LeavesStraightStraightsAlone) {
  std::mt19937_64 random(7);
  const auto cloud = tests::ScanRealTube(ThreeBends(), {}, {}, random);
  std::vector<PointBlock> blocks = {{Eigen::Vector3d::Zero(), 1e3, cloud.points_W}};
  const SurfaceFitOptions options{.reach_mm = 1};
  const SurfaceFit straight = FitSurface(ThreeBends(), blocks, options);
  SurfaceFit fit = straight;
  FitBows(blocks, options, fit);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(fit.tube.program.rows[i].angle_deg, straight.tube.program.rows[i].angle_deg);
    EXPECT_LT(fit.sigma.rows[i].angle_deg, 1.3 * straight.sigma.rows[i].angle_deg);
  }
}

}  // namespace
}  // namespace bendloop::pipeline
