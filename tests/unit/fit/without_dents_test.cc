// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/without_dents.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "pipeline/fit/bowed_fit.h"
#include "pipeline/reconstruction.h"
#include "tests/support/real_tube.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

TEST(WithoutDents, SlopesOfDentsPullNothing) {
  for (const double along : {0.2, 0.33, 0.5}) {
    SCOPED_TRACE(along);
    std::mt19937_64 random(5);
    const tests::Form form{.dents = {{.along = along, .around_rad = 1.0, .depth_r = 0.15}}};
    const auto cloud = tests::ScanRealTube(ThreeBends(), form, {.noise_mm = 0.02}, random);
    const std::vector<PointBlock> blocks = {{Eigen::Vector3d::Zero(), 1e3, cloud.points_W}};
    SurfaceFitOptions options{.reach_mm = kReachMm};
    SurfaceFit dented = FitSurface(ThreeBends(), blocks, options);
    const BowedFit bows = FitBows(blocks, options, dented);
    EXPECT_TRUE(bows.is_pulled_aside);
    const auto left = WithoutDents(bows.state, bows.noise_mm, blocks, blocks, kReachMm);
    ASSERT_TRUE(left);
    EXPECT_GT(left->point_count(), cloud.points_W.size() * 85 / 100);
    const auto wider =
        WithoutDents(bows.state, bows.noise_mm, blocks, blocks, kReachMm, {.wide = 1.3});
    ASSERT_TRUE(wider);
    EXPECT_LT(wider->point_count(), left->point_count());
    SurfaceFit fit = FitSurface(ThreeBends(), *left, options);
    FitBows(*left, options, fit);
    EXPECT_NEAR(fit.tube.pipe_radius_mm, 5, 4 * fit.pipe_radius_sigma_mm);
    EXPECT_LT(fit.pipe_radius_sigma_mm, 0.002);
    for (std::size_t i = 0; i < 3; ++i) {
      const auto &is = fit.tube.program.rows[i], &was = cloud.truth.program.rows[i];
      EXPECT_NEAR(is.angle_deg, was.angle_deg, 4 * fit.sigma.rows[i].angle_deg);
      EXPECT_LT(fit.sigma.rows[i].angle_deg, 0.03);
    }
  }
}

// A dent inside a bend and as wide, beside another one: lines and arcs take half of it in, and what
// they leave looks shallow and small.
TEST(WithoutDents, ABendThatIsDentedKeepsItsRadius) {
  std::mt19937_64 random(1);
  const tests::Form form{.dents = {{.along = 0.22, .around_rad = 0, .depth_r = 0.11},
                                   {.along = 0.34, .around_rad = -1.1, .depth_r = 0.18}}};
  const auto cloud = tests::ScanRealTube(ThreeBends(), form, {}, random);
  ReconstructionOptions options;
  options.nominal = cloud.truth.program;
  const auto found = Reconstruct(cloud.points_W, options, kClock);
  ASSERT_TRUE(found) << found.error().message;
  ASSERT_EQ(found->tube.program.rows.size(), 4U);
  const bool reversed = std::abs(found->tube.program.rows[0].angle_deg - 60) > 5;
  for (std::size_t i = 0; i < 3; ++i) {
    SCOPED_TRACE(i);
    const std::size_t k = reversed ? 2 - i : i;
    const auto &is = found->tube.program.rows[k], &was = cloud.truth.program.rows[i];
    EXPECT_NEAR(*is.bend_radius_mm, *was.bend_radius_mm, 5 * *found->sigma.rows[k].bend_radius_mm);
    EXPECT_LT(*found->sigma.rows[k].bend_radius_mm, 1.2);
  }
}

TEST(WithoutDents, ATubeWithoutThemKeepsItsPoints) {
  std::mt19937_64 random(7);
  const auto cloud = tests::ScanRealTube(ThreeBends(), {}, {}, random);
  const std::vector<PointBlock> blocks = {{Eigen::Vector3d::Zero(), 1e3, cloud.points_W}};
  const SurfaceFitOptions options{.reach_mm = kReachMm};
  SurfaceFit fit = FitSurface(ThreeBends(), blocks, options);
  const BowedFit bows = FitBows(blocks, options, fit);
  EXPECT_FALSE(bows.is_pulled_aside);
  EXPECT_FALSE(WithoutDents(bows.state, bows.noise_mm, blocks, blocks, kReachMm));
}

}  // namespace
}  // namespace bendloop::pipeline
