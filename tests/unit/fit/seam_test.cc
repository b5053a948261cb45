// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/seam.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "pipeline/reconstruction.h"
#include "tests/support/real_tube.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

tests::RealCloud ScanWith(const tests::Form& form, const tests::RealScan& scan,
                          std::uint64_t seed) {
  std::mt19937_64 random(seed);
  return tests::ScanRealTube(ThreeBends(), form, scan, random);
}

std::vector<PointBlock> BlocksOf(const tests::RealCloud& cloud) {
  return {{Eigen::Vector3d::Zero(), 1e3, cloud.points_W}};
}

std::optional<SeamFound> SeamOf(const tests::RealCloud& cloud) {
  const auto blocks = BlocksOf(cloud);
  return FindSeam(FitSurface(ThreeBends(), blocks, {.reach_mm = kReachMm}), blocks, kReachMm);
}

// Drawn as a Gaussian of 0.12 rad.
TEST(Seam, HasItsHeightAndWidth) {
  for (const double height : {0.012, 0.03, 0.06}) {
    for (const double noise_mm : {0.01, 0.05}) {
      SCOPED_TRACE(testing::Message() << height << " at " << noise_mm);
      const auto seam = SeamOf(ScanWith({.seam = height}, {.noise_mm = noise_mm}, 7));
      ASSERT_TRUE(seam);
      EXPECT_NEAR(seam->height_mm, 5 * height, 5 * seam->sigma_mm + 0.1 * 5 * height);
      EXPECT_NEAR(seam->width_mm, 2.355 * 0.12 * 5, 0.3 * 2.355 * 0.12 * 5);
    }
  }
}

// Narrow ones, too, beside noise a third as wide as they are.
TEST(Seam, IsAsHighAsItSays) {
  double height = 0, values = 0;
  for (const double width_rad : {0.03, 0.06, 0.12, 0.2}) {
    for (const double noise_mm : {0.01, 0.05}) {
      for (const std::uint64_t seed : {1U, 2U, 3U}) {
        SCOPED_TRACE(testing::Message() << width_rad << " at " << noise_mm << ", " << seed);
        const auto cloud = ScanWith({.seam = 0.04, .seam_rad = width_rad},
                                    {.points = 100'000, .noise_mm = noise_mm}, seed);
        const auto measured = Reconstruct(cloud.points_W, {}, kClock);
        ASSERT_TRUE(measured && measured->seam);
        const SeamFound& seam = *measured->seam;
        height += std::pow((seam.height_mm - 5 * 0.04) / seam.sigma_mm, 2);
        values += 1;
        EXPECT_NEAR(seam.width_mm, 2.355 * width_rad * 5, 0.15 * 2.355 * width_rad * 5);
        EXPECT_LT(seam.sigma_mm, 0.05 * seam.height_mm);
      }
    }
  }
  EXPECT_LT(std::sqrt(height / values), 1.4);
}

// All along, round bends in three planes: what is left of the points is even.
TEST(Seam, GoesWithTheTubeAndItsPointsAreLeftOut) {
  const auto cloud = ScanWith({.seam = 0.06}, {.noise_mm = 0.02}, 8);
  const auto blocks = BlocksOf(cloud);
  const SurfaceFit fit = FitSurface(ThreeBends(), blocks, {.reach_mm = kReachMm});
  const auto seam = FindSeam(fit, blocks, kReachMm);
  ASSERT_TRUE(seam);
  const OwnedBlocks left = WithoutSeam(fit, *seam, blocks);
  EXPECT_GT(left.point_count(), cloud.points_W.size() * 80 / 100);
  const SurfaceFit beside = FitSurface(ThreeBends(), left, {.reach_mm = kReachMm});
  EXPECT_LT(beside.design_effect, 1.1);
  EXPECT_NEAR(beside.sigma_mm, 0.02, 0.001);
  EXPECT_NEAR(beside.tube.pipe_radius_mm, 5, 4 * beside.pipe_radius_sigma_mm);
}

TEST(Seam, IsNoneWhereFormIsOfAnotherKind) {
  const std::vector<std::pair<std::string, tests::Form>> forms = {
      {"plain", {}},
      {"bowed", {.bow = 1.0 / 500}},
      {"eased", {.easing_r = 0.7}},
      {"oval", {.ovality = 0.06}},
      {"wrinkled", {.ovality = 0.05, .wrinkles = 0.02}},
      {"dented",
       {.dents = {{.along = 0.2, .around_rad = 1, .depth_r = 0.1},
                  {.along = 0.5, .around_rad = -1, .depth_r = 0.05, .width_r = 0.4},
                  {.along = 0.8, .around_rad = 3, .depth_r = 0.15, .width_r = 1.2}}}},
      {"flange", {.at_end = tests::EndFitting::kFlange}}};
  for (const auto& [name, form] : forms) {
    for (const double noise_mm : {0.005, 0.05}) {
      SCOPED_TRACE(name);
      EXPECT_FALSE(SeamOf(ScanWith(form, {.noise_mm = noise_mm}, 9)));
      EXPECT_FALSE(SeamOf(ScanWith(form, {.noise_mm = noise_mm, .drift_mm = 0.1}, 10)));
      EXPECT_FALSE(SeamOf(ScanWith(form, {.noise_mm = noise_mm, .views = 1}, 11)));
    }
  }
}

// It pulls the spine to its side all along, and no straight or bend is less certain for it.
TEST(Seam, LeavesRowsAsCertainAsTheyAreWithoutIt) {
  const auto measure = [](double seam) {
    auto measured = Reconstruct(ScanWith({.seam = seam}, {}, 12).points_W, {}, kClock);
    EXPECT_TRUE(measured);
    return *measured;
  };
  const Measurement plain = measure(0), seamed = measure(0.05);
  EXPECT_FALSE(plain.seam);
  ASSERT_TRUE(seamed.seam);
  EXPECT_LT(seamed.pipe_radius_sigma_mm, 0.003);
  EXPECT_NEAR(seamed.tube.pipe_radius_mm, 5, 4 * seamed.pipe_radius_sigma_mm);
  ASSERT_EQ(seamed.tube.program.bend_count(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    const auto &sigma = seamed.sigma.rows[i], &without = plain.sigma.rows[i];
    EXPECT_LT(sigma.angle_deg, 1.3 * without.angle_deg);
    EXPECT_LT(sigma.length_mm, 1.3 * without.length_mm);
  }
  EXPECT_TRUE(seamed.warnings.empty()) << seamed.warnings.front();
}

}  // namespace
}  // namespace bendloop::pipeline
