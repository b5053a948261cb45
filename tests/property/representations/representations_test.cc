// SPDX-License-Identifier: Apache-2.0
// What must hold for every tube; random tubes with fixed seeds, the failing seed is printed.
#include "pipeline/tube/representations.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "hal/spine.h"

namespace bendloop::pipeline {
namespace {

constexpr int kTubes = 500;

hal::Pose RandomPose(std::mt19937& random) {
  std::normal_distribution<double> normal;
  Eigen::Quaterniond q(normal(random), normal(random), normal(random), normal(random));
  return {1000 * Eigen::Vector3d(normal(random), normal(random), normal(random)), q.normalized()};
}

hal::Tube RandomTube(std::mt19937& random, double largest_angle_deg) {
  std::uniform_real_distribution<double> length(0, 300);
  std::uniform_real_distribution<double> rotation(-179.9, 180);
  std::uniform_real_distribution<double> angle(0.5, largest_angle_deg);
  std::uniform_real_distribution<double> radius(5, 120);
  std::uniform_int_distribution<int> bends(0, 12);
  hal::Tube tube;
  const int n = bends(random);
  for (int i = 0; i <= n; ++i) {
    hal::BendRow row;
    row.length_mm = i % 3 == 1 ? 0.0 : 1 + length(random);  // neighbouring bends are usual
    if (i < n) {
      row.angle_deg = angle(random);
      row.bend_radius_mm = radius(random);
      if (i > 0) row.rotation_deg = rotation(random);
    }
    tube.program.rows.push_back(row);
  }
  tube.X_WT = RandomPose(random);
  return tube;
}

void ExpectSameProgram(const hal::BendProgram& a, const hal::BendProgram& b, double tolerance) {
  ASSERT_EQ(a.rows.size(), b.rows.size());
  for (std::size_t i = 0; i < a.rows.size(); ++i) {
    EXPECT_NEAR(a.rows[i].length_mm, b.rows[i].length_mm, tolerance) << "row " << i;
    EXPECT_NEAR(hal::WrapRotationDeg(a.rows[i].rotation_deg - b.rows[i].rotation_deg), 0, tolerance)
        << "row " << i;
    EXPECT_NEAR(a.rows[i].angle_deg, b.rows[i].angle_deg, tolerance) << "row " << i;
    EXPECT_EQ(a.rows[i].bend_radius_mm, b.rows[i].bend_radius_mm) << "row " << i;
  }
}

TEST(RepresentationProperty, LraToXyzToLraIsTheIdentity) {
  for (int seed = 0; seed < kTubes; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    const hal::Tube tube = RandomTube(random, 150);
    const auto polygon = PolygonFromTube(tube);
    ASSERT_TRUE(polygon) << polygon.error().message;
    const auto back = TubeFromPolygon(*polygon);
    ASSERT_TRUE(back) << back.error().message;
    ExpectSameProgram(back->program, tube.program, 1e-6);
    EXPECT_LT((back->X_WT.position_mm - tube.X_WT.position_mm).norm(), 1e-9);
    if (tube.program.bend_count() > 0) {
      EXPECT_LT(back->X_WT.orientation.angularDistance(tube.X_WT.orientation), 1e-6);
    }
  }
}

TEST(RepresentationProperty, RigidMotionOfThePointsLeavesLraAlone) {
  for (int seed = 0; seed < kTubes; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    const auto polygon = PolygonFromTube(RandomTube(random, 150));
    ASSERT_TRUE(polygon);
    ControlPolygon moved = *polygon;
    const hal::Pose motion = RandomPose(random);
    for (auto& point : moved.points_mm) point = motion * point;
    const auto a = TubeFromPolygon(*polygon);
    const auto b = TubeFromPolygon(moved);
    ASSERT_TRUE(a && b);
    ExpectSameProgram(a->program, b->program, 1e-6);
  }
}

TEST(RepresentationProperty, AMirrorFlipsTheRotationsAndNothingElse) {
  for (int seed = 0; seed < kTubes; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    const auto polygon = PolygonFromTube(RandomTube(random, 150));
    ASSERT_TRUE(polygon);
    ControlPolygon mirrored = *polygon;
    for (auto& point : mirrored.points_mm) point.x() = -point.x();
    auto a = TubeFromPolygon(*polygon);
    const auto b = TubeFromPolygon(mirrored);
    ASSERT_TRUE(a && b);
    for (auto& row : a->program.rows) row.rotation_deg = -row.rotation_deg;
    ExpectSameProgram(a->program, b->program, 1e-6);
  }
}

TEST(RepresentationProperty, ReversedPointsAreTheReversedProgram) {
  for (int seed = 0; seed < kTubes; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    const auto polygon = PolygonFromTube(RandomTube(random, 150));
    ASSERT_TRUE(polygon);
    const ControlPolygon reversed{{polygon->points_mm.rbegin(), polygon->points_mm.rend()},
                                  {polygon->bend_radii_mm.rbegin(), polygon->bend_radii_mm.rend()}};
    const auto a = TubeFromPolygon(*polygon);
    const auto b = TubeFromPolygon(reversed);
    ASSERT_TRUE(a && b);
    ExpectSameProgram(ReverseProgram(a->program), b->program, 1e-6);
  }
}

// Also with bends beyond 180 degrees, which a polygon could not show.
TEST(RepresentationProperty, TheReversedTubeIsTheSameSpineAndTwiceIsTheIdentity) {
  for (int seed = 0; seed < kTubes; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    const hal::Tube tube = RandomTube(random, 340);
    const hal::Tube reversed = ReverseTube(tube);
    const auto there = hal::SpineSegments(tube.program, tube.X_WT);
    const auto back = hal::SpineSegments(reversed.program, reversed.X_WT);
    ASSERT_EQ(there.size(), back.size());
    for (std::size_t i = 0; i < there.size(); ++i) {
      const auto& twin = back[back.size() - 1 - i];
      const double middle_mm = 0.5 * there[i].length_mm;
      EXPECT_LT((there[i].PointAt(middle_mm) - twin.PointAt(middle_mm)).norm(), 1e-7) << i;
      EXPECT_LT((there[i].TangentAt(middle_mm) + twin.TangentAt(middle_mm)).norm(), 1e-9) << i;
    }
    const hal::Tube again = ReverseTube(reversed);
    ExpectSameProgram(again.program, tube.program, 0);
    EXPECT_LT((again.X_WT.position_mm - tube.X_WT.position_mm).norm(), 1e-7);
    EXPECT_LT(again.X_WT.orientation.angularDistance(tube.X_WT.orientation), 1e-7);
  }
}

TEST(RepresentationProperty, EveryYbcStyleComesBack) {
  for (int seed = 0; seed < kTubes; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    const hal::Tube tube = RandomTube(random, 340);
    for (const FeedCount feed :
         {FeedCount::kIncremental, FeedCount::kAlongSpine, FeedCount::kStraights}) {
      for (const RotationCount rotation :
           {RotationCount::kIncremental, RotationCount::kCumulative}) {
        for (const int sign : {1, -1}) {
          const YbcStyle style{feed, rotation, sign};
          const auto ybc = YbcFromProgram(tube.program, style);
          ASSERT_TRUE(ybc) << ybc.error().message;
          for (const YbcRow& row : *ybc) {
            if (rotation != RotationCount::kCumulative) continue;
            EXPECT_GE(row.b_deg, 0);
            EXPECT_LT(row.b_deg, 360);
          }
          const auto program = ProgramFromYbc(*ybc, style);
          ASSERT_TRUE(program) << program.error().message;
          ExpectSameProgram(*program, tube.program, 1e-8);
        }
      }
    }
  }
}

}  // namespace
}  // namespace bendloop::pipeline
