// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/feature_borders.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>
#include <random>

#include "pipeline/features/convex_hull.h"
#include "pipeline/features/point_characteristics.h"
#include "tests/support/grooved_handle.h"

namespace bendloop::pipeline {
namespace {

using namespace bendloop::tests;
using Eigen::Vector3d;

constexpr std::size_t kPoints = 12'000;

std::size_t Concave(const FeatureBorders& found) {
  return static_cast<std::size_t>(
      std::count_if(found.regions.begin(), found.regions.end(),
                    [](const FeatureRegion& region) { return region.concave; }));
}

TEST(FeatureBorders, FindsTheGroovesOfAHandle) {
  for (const double noise_mm : {0.0, 0.03}) {
    const auto found = FindFeatureBorders(GroovedHandle().Scan(kPoints, noise_mm, 1));
    ASSERT_TRUE(found);
    EXPECT_EQ(Concave(*found), 6U);
    ASSERT_EQ(found->regions.size(), 7U);
    EXPECT_FALSE(found->regions[0].concave);
    for (const FeatureBorder& border : found->borders) {
      // What the paper reaches in its first segment.
      EXPECT_LT(border.fit.Relative(), 2e-4 + 1e-3 * noise_mm / 0.03);
      for (std::size_t p = 0; p < border.fit.curve.pieces.size(); ++p) {
        if (border.fit.curve.corner[p]) continue;
        EXPECT_LT(border.fit.curve.JointAngle(p), 1e-9);
      }
    }
  }
}

TEST(FeatureBorders, DoNotDependOnTheOrderOfThePoints) {
  std::vector<Vector3d> cloud = GroovedHandle().Scan(kPoints, 0.02, 2);
  const auto one = FindFeatureBorders(cloud);
  std::shuffle(cloud.begin(), cloud.end(), std::mt19937(7));
  cloud.insert(cloud.end(), cloud.begin(), cloud.begin() + 500);  // twice
  const auto other = FindFeatureBorders(cloud);
  ASSERT_TRUE(one && other);
  ASSERT_EQ(one->regions.size(), other->regions.size());
  ASSERT_EQ(one->borders.size(), other->borders.size());
  for (std::size_t b = 0; b < one->borders.size(); ++b) {
    const double sum_mm2 = one->borders[b].fit.SumMm2();
    EXPECT_NEAR(other->borders[b].fit.SumMm2(), sum_mm2, 1e-6 * sum_mm2);
  }
}

TEST(FeatureBorders, MoveWithTheCloud) {
  std::vector<Vector3d> cloud = GroovedHandle().Scan(kPoints, 0.02, 3);
  const auto here = FindFeatureBorders(cloud);
  const Eigen::Isometry3d motion =
      Eigen::Translation3d(200, -30, 5) * Eigen::AngleAxisd(0.7, Vector3d(1, 1, 2).normalized());
  for (Vector3d& point : cloud) point = motion * point;
  const auto there = FindFeatureBorders(cloud);
  ASSERT_TRUE(here && there);
  ASSERT_EQ(here->regions.size(), there->regions.size());
  // Points are in another order then, and those of a border may go to its other side.
  EXPECT_LT((motion * here->regions[0].center_mm - there->regions[0].center_mm).norm(), 0.3);
  EXPECT_NEAR(here->noise_sigma_mm, there->noise_sigma_mm, 1e-3);
}

TEST(Concavity, IsTheDistanceToTheHull) {
  std::vector<Vector3d> cube;
  for (int x = -5; x <= 5; ++x) {
    for (int y = -5; y <= 5; ++y) {
      for (int z = -5; z <= 5; ++z) cube.emplace_back(x + 100, y, z);
    }
  }
  const auto planes = ConvexHull(cube);
  ASSERT_TRUE(planes);
  const auto depth_mm = ConcavityMm(cube, nullptr);
  ASSERT_TRUE(depth_mm);
  for (std::size_t i = 0; i < cube.size(); ++i) {
    const double expected = 5 - (cube[i] - Vector3d(100, 0, 0)).cwiseAbs().maxCoeff();
    EXPECT_NEAR((*depth_mm)[i], expected, 1e-9);
  }
}

TEST(FeatureBorders, RefuseWhatShowsNone) {
  std::vector<Vector3d> cloud;
  EXPECT_FALSE(FindFeatureBorders(cloud));
  cloud.assign(5000, Vector3d(1, 2, 3));
  EXPECT_FALSE(FindFeatureBorders(cloud));
  cloud.clear();
  for (int i = 0; i < 1000; ++i) cloud.emplace_back(i, 2 * i, 3);
  EXPECT_FALSE(FindFeatureBorders(cloud));  // a line
  cloud.clear();
  for (int i = 0; i < 1000; ++i) cloud.emplace_back(i % 33, i / 33, 0);
  const auto plane = FindFeatureBorders(cloud);
  ASSERT_FALSE(plane);
  EXPECT_NE(plane.error().message.find("no body"), std::string::npos) << plane.error().message;
  cloud = GroovedHandle().Scan(2000, 0, 1);
  cloud[77].y() = std::numeric_limits<double>::quiet_NaN();
  const auto nan = FindFeatureBorders(cloud);
  ASSERT_FALSE(nan);
  EXPECT_NE(nan.error().message.find("point 78"), std::string::npos) << nan.error().message;
}

TEST(FeatureBorders, ThinWhatIsMany) {
  FeatureOptions options;
  options.most_points = 8000;
  const auto found = FindFeatureBorders(GroovedHandle().Scan(60'000, 0.02, 4), options);
  ASSERT_TRUE(found);
  EXPECT_LE(found->points_used, 8000U);
  EXPECT_GT(found->points_used, 4000U);
  // All six; of so few points a sliver where a groove runs out may stand alone.
  EXPECT_GE(Concave(*found), 6U);
  EXPECT_LE(Concave(*found), 7U);
  EXPECT_FALSE(found->warnings.empty());
}

}  // namespace
}  // namespace bendloop::pipeline
