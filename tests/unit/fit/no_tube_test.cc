// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "pipeline/reconstruction.h"
#include "tests/support/real_tube.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

TEST(NoTube, ACoilIsNoStraightPipeAsWideAsAllOfIt) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> turn(0, 2 * std::numbers::pi);
  std::normal_distribution<double> noise(0, 0.05);
  constexpr double kCoil_mm = 37, kPipe_mm = 3, kPitch_mm = 14;
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 60'000; ++i) {
    const double along = 12 * turn(random), around = turn(random);
    const Eigen::Vector3d out(std::cos(along), std::sin(along), 0), up(0, 0, 1);
    const double r_mm = kPipe_mm + noise(random);
    points.push_back((kCoil_mm + r_mm * std::cos(around)) * out +
                     (kPitch_mm * along / (2 * std::numbers::pi) + r_mm * std::sin(around)) * up);
  }
  const auto found = Reconstruct(points, {}, kClock);
  if (found) {
    EXPECT_LT(found->tube.pipe_radius_mm, 2 * kPipe_mm);
    EXPECT_GT(found->tube.program.bend_count(), 0U);
  } else {
    EXPECT_EQ(found.error().kind, hal::ErrorKind::kBadInput);
  }
}

// A hose: its curvature is a sine all along.
TEST(NoTube, OneThatIsBentFreelyIsToldToHaveNoStraights) {
  constexpr double kPipe_mm = 10, kLong_mm = 300, kStep_mm = 0.05, kTightest_mm = 60;
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> turn(0, 2 * std::numbers::pi);
  std::normal_distribution<double> noise(0, 0.03);
  std::vector<Eigen::Vector3d> points;
  Eigen::Vector2d at = Eigen::Vector2d::Zero();
  double heading = 0;
  for (double along = 0; along < kLong_mm; along += kStep_mm) {
    const Eigen::Vector2d ahead(std::cos(heading), std::sin(heading));
    at += kStep_mm * ahead;
    heading += kStep_mm / kTightest_mm * std::sin(2 * std::numbers::pi * along / kLong_mm);
    for (int i = 0; i < 4; ++i) {
      const double around = turn(random), r_mm = kPipe_mm + noise(random);
      const Eigen::Vector2d place =
          at + r_mm * std::cos(around) * Eigen::Vector2d(-ahead.y(), ahead.x());
      points.emplace_back(place.x(), place.y(), r_mm * std::sin(around));
    }
  }
  const auto found = Reconstruct(points, {}, kClock);
  ASSERT_TRUE(found) << found.error().message;
  const auto is_told = [](const std::string& warning) {
    return warning.find("the tube may be bent freely") != warning.npos;
  };
  EXPECT_TRUE(found->tube.program.rows.empty() ||
              std::any_of(found->warnings.begin(), found->warnings.end(), is_told));
}

// Pressed to an ellipse over 30 mm of 270, as in a vice: a twentieth of all points.
TEST(NoTube, AFlatPlaceIsToldHoweverShort) {
  hal::Tube tube;
  tube.pipe_radius_mm = 5;
  tube.program.rows = {{100, 0, 60, 15}, {150, 0, 0, {}}};
  std::mt19937_64 random(1);
  for (const double depth : {0.0, 0.3, 0.5}) {
    SCOPED_TRACE(depth);
    auto points = tests::ScanRealTube(tube, {}, {.points = 24'000}, random).points_W;
    for (Eigen::Vector3d& point : points) {
      const double off = (point.x() - 50) / 15;
      if (std::abs(off) > 1 || point.y() > 20) continue;
      const double pressed = depth * std::pow(std::cos(0.5 * std::numbers::pi * off), 2);
      point.z() *= 1 - pressed;
      point.y() *= 1 + 0.5 * pressed;
    }
    const auto found = Reconstruct(points, {}, kClock);
    ASSERT_TRUE(found) << found.error().message;
    EXPECT_EQ(found->tube.program.bend_count(), 1U);
    const auto is_told = [](const std::string& warning) {
      return warning.find("it is pressed flat there, or something is around it") != warning.npos;
    };
    EXPECT_EQ(std::any_of(found->warnings.begin(), found->warnings.end(), is_told), depth > 0);
  }
}

TEST(NoTube, PointsBesideTheTubeAreToldWithTheirPlace) {
  hal::Tube tube;
  tube.pipe_radius_mm = 5;
  tube.program.rows = {{80, 0, 60, 15}, {100, 0, 0, {}}};
  std::mt19937_64 random(1);
  auto points = tests::ScanRealTube(tube, {}, {.points = 12'000}, random).points_W;
  // A wall about the first straight, 2 mm off it, from 30 to 50 mm.
  std::uniform_real_distribution<double> along(30, 50), around(0, 2 * std::numbers::pi);
  for (int i = 0; i < 3000; ++i) {
    const double turn = around(random);
    points.emplace_back(along(random), 7.0 * std::cos(turn), 7.0 * std::sin(turn));
  }
  ReconstructionOptions options;
  options.pipe_radius_mm = 5;
  const auto found = Reconstruct(points, options, kClock);
  ASSERT_TRUE(found) << found.error().message;
  bool is_told = false;
  for (const std::string& warning : found->warnings) {
    is_told |= warning.find("of the points beside the tube do not lie on it, most of them from") !=
               warning.npos;
  }
  EXPECT_TRUE(is_told);
}

TEST(NoTube, AnotherPartThanTheNominalsIsSaidToBeOne) {
  hal::Tube tube;
  tube.pipe_radius_mm = 5;
  tube.program.rows = {{45, 0, 60, 15}, {55, 80, 35, 12}, {40, -120, 90, 17}, {50, 0, 0, {}}};
  std::mt19937_64 random(1);
  const auto points = tests::ScanRealTube(tube, {}, {}, random).points_W;
  const auto says = [&](const hal::BendProgram& nominal, const std::string& what) {
    ReconstructionOptions options;
    options.nominal = nominal;
    const auto found = Reconstruct(points, options, kClock);
    if (!found) return false;
    bool said = false;
    for (const std::string& warning : found->warnings) said |= warning.find(what) != warning.npos;
    return said;
  };
  EXPECT_FALSE(says(tube.program, "part"));
  hal::BendProgram mirrored = tube.program;
  for (hal::BendRow& row : mirrored.rows) row.rotation_deg = -row.rotation_deg;
  EXPECT_TRUE(says(mirrored, "mirror image"));
  hal::BendProgram other = tube.program;
  other.rows[1].angle_deg = 75;
  EXPECT_TRUE(says(other, "not the part"));
  hal::BendProgram fewer = tube.program;
  fewer.rows.erase(fewer.rows.begin() + 1);
  EXPECT_TRUE(says(fewer, "the nominal has 2"));
}

}  // namespace
}  // namespace bendloop::pipeline
