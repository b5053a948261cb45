// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/pipe_radius.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/pipe_along.h"

namespace bendloop::pipeline {
namespace {

using tests::Points;
using tests::Random;
using tests::Uniform;

struct Scan {
  double radius;
  double noise;  // of the radius
  std::size_t points;
};

TEST(PipeRadius, FindsManyRadii) {
  Random random(1);
  for (const Scan& scan : {Scan{0.8, 0.01, 6000}, Scan{2, 0.05, 6000}, Scan{4, 0.0, 6000},
                           Scan{4, 0.0125, 30000}, Scan{12.7, 0.02, 6000}, Scan{48, 0.005, 8000}}) {
    const hal::Tube tube = tests::RandomTube({.pipe_radius_mm = scan.radius, .bends = 3}, random);
    const auto points = tests::SyntheticCloud(
        tube, {.points = scan.points, .noise_mm = scan.noise * scan.radius}, random);
    const auto found = EstimatePipeRadius(points);
    ASSERT_TRUE(found) << scan.radius;
    EXPECT_NEAR(found->radius_mm / scan.radius, 1, 0.03) << scan.radius;
    EXPECT_GT(found->support, 0.1) << scan.radius;
    EXPECT_LE(found->support, 1) << scan.radius;
    EXPECT_LT(found->sigma_mm, 0.02 * scan.radius) << scan.radius;
    if (scan.noise > 0) {
      EXPECT_NEAR(found->noise_mm / (scan.noise * scan.radius), 1, 0.5) << scan.radius;
    }
  }
}

TEST(PipeRadius, OneSideOnlyIsEnough) {
  Random random(2);
  const hal::Tube tube = tests::RandomTube({.pipe_radius_mm = 5, .bends = 2}, random);
  const auto points =
      tests::SyntheticCloud(tube, {.noise_mm = 0.05, .view_W = Eigen::Vector3d::UnitZ()}, random);
  const auto found = EstimatePipeRadius(points);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->radius_mm, 5, 0.2);
}

TEST(PipeRadius, ATableAndFliersDoNotMatter) {
  Random random(3);
  const hal::Tube tube = tests::RandomTube({.pipe_radius_mm = 5, .bends = 2}, random);
  Points points = tests::SyntheticCloud(tube, {.noise_mm = 0.05, .fliers = 0.05}, random);
  for (Eigen::Vector3d& p : points) p -= tube.X_WT.position_mm;
  for (const Eigen::Vector3d& p : tests::PlanePoints(200, 12000, random, 0.05)) {
    points.push_back(p - Eigen::Vector3d(0, 0, 150));
  }
  std::shuffle(points.begin(), points.end(), random);
  const auto found = EstimatePipeRadius(points);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->radius_mm, 5, 0.2);
}

TEST(PipeRadius, AFewHundredPointsAreEnough) {
  Random random(4);
  const hal::Tube tube = tests::RandomTube(
      {.pipe_radius_mm = 5, .bends = 1, .min_straight = 4, .max_straight = 6}, random);
  const auto found =
      EstimatePipeRadius(tests::SyntheticCloud(tube, {.points = 700, .noise_mm = 0.02}, random));
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->radius_mm, 5, 0.3);
}

TEST(PipeRadius, DoesNotDependOnPose) {
  Random random(5);
  const hal::Tube tube = tests::RandomTube({.pipe_radius_mm = 5, .bends = 2}, random);
  const Points points = tests::SyntheticCloud(tube, {}, random);
  const auto a = EstimatePipeRadius(points);
  const auto b = EstimatePipeRadius(tests::Moved(points, tests::RandomPose(1000, random)));
  ASSERT_TRUE(a && b);
  EXPECT_NEAR(a->radius_mm, b->radius_mm, 0.05);
}

// A reading at the sensor's far limit, or at its zero, must not hide the tube.
TEST(PipeRadius, APointFarAwayDoesNotMatter) {
  Random random(6);
  const hal::Tube tube = tests::RandomTube({.pipe_radius_mm = 4, .bends = 2}, random);
  for (const double far : {1e3, 3e4, 1e7, 1e300}) {
    Points points = tests::SyntheticCloud(tube, {}, random);
    points.insert(points.begin() + 17, Eigen::Vector3d(far, 0, 0));
    const auto found = EstimatePipeRadius(points);
    ASSERT_TRUE(found) << far;
    EXPECT_NEAR(found->radius_mm, 4, 0.15) << far;
  }
}

void ExpectNone(const Points& points) {
  const auto found = EstimatePipeRadius(points);
  ASSERT_FALSE(found) << "found radius " << found->radius_mm << ", support " << found->support;
  EXPECT_EQ(found.error().kind, hal::ErrorKind::kBadInput);
}

TEST(PipeRadius, RefusesPlanesSpheresAndNoise) {
  Random random(7);
  ExpectNone({});
  ExpectNone({{1, 2, 3}});
  ExpectNone(Points(500, {1, 2, 3}));
  ExpectNone(tests::PlanePoints(100, 5000, random));
  ExpectNone(tests::PlanePoints(100, 5000, random, 0.1));
  ExpectNone(tests::SpherePoints(50, 5000, random, 0.05));
  Points noise;
  for (int i = 0; i < 5000; ++i) {
    noise.emplace_back(Uniform(random, 0, 100), Uniform(random, 0, 100), Uniform(random, 0, 100));
  }
  ExpectNone(noise);
}

// Which looks like one pipe as wide as all of it, but for what that leaves.
TEST(PipeRadius, OfACoilIsThatOfItsPipe) {
  Random random(9);
  for (const double pitch_mm : {7.0, 14.0, 25.0}) {
    const auto found = EstimatePipeRadius(
        tests::PipeAlong(tests::Helix(37, pitch_mm, 6), 3, 20'000, 0.05, random));
    ASSERT_TRUE(found) << pitch_mm;
    EXPECT_NEAR(found->radius_mm, 3, 0.1) << pitch_mm;
  }
}

// Metres of wire: the points that tell how large the cloud is are too few for so thin a one.
TEST(PipeRadius, OfALongWireWithManyBends) {
  Random random(10);
  for (const double radius_mm : {1.0, 3.0}) {
    const hal::Tube wire = tests::RandomTube({.pipe_radius_mm = radius_mm,
                                              .bends = 25,
                                              .min_bend_radius = 4,
                                              .max_bend_radius = 10,
                                              .min_straight = 150 / radius_mm,
                                              .max_straight = 300 / radius_mm,
                                              .min_angle_deg = 20,
                                              .max_angle_deg = 110,
                                              .one_bend_radius = false},
                                             random);
    const auto found = EstimatePipeRadius(
        tests::SyntheticCloud(wire, {.points = 150'000, .noise_mm = 0.03}, random));
    ASSERT_TRUE(found) << radius_mm;
    EXPECT_NEAR(found->radius_mm / radius_mm, 1, 0.05);
  }
}

TEST(PipeRadius, SaysWhatWasExpected) {
  Random random(8);
  const auto found = EstimatePipeRadius(tests::PlanePoints(100, 2000, random));
  ASSERT_FALSE(found);
  EXPECT_THAT(found.error().message, testing::HasSubstr("no pipe found"));
  EXPECT_THAT(found.error().message, testing::HasSubstr("expected"));
}

}  // namespace
}  // namespace bendloop::pipeline
