// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/registration.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "pipeline/reconstruction.h"
#include "tests/support/real_tube.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

hal::Tube FourBends() {
  hal::Tube tube;
  tube.pipe_radius_mm = 5;
  tube.program.rows = {
      {45, 0, 60, 15}, {55, 80, 35, 15}, {40, -120, 90, 15}, {60, 30, 40, 15}, {50, 0, 0, {}}};
  return tube;
}

// The passes of a real scan as profiles: each from its own side, after a pause. A profile is what a
// sensor at `far` that looks along the line to a point would see of it: one point each.
void Feed(const tests::RealCloud& cloud, int views, Reconstruction& reconstruction) {
  const std::size_t of_view = cloud.points_W.size() / static_cast<std::size_t>(views);
  std::int64_t t_ns = 0;
  for (std::size_t i = 0; i < cloud.points_W.size(); i += 50) {
    if (i > 0 && i / of_view != (i - 50) / of_view) t_ns += 2'000'000'000;
    hal::LaserProfile profile(50);
    profile.t_ns = t_ns += 1'000'000;
    const double turn = 2 * std::numbers::pi * static_cast<double>(i / of_view) / views;
    profile.X_WS.position_mm = Eigen::Vector3d(0, 300 * std::cos(turn), 300 * std::sin(turn));
    // Laser planes hold points of y = 0: each point has a profile's worth of plane of its own.
    for (std::size_t k = i; k < std::min(i + 50, cloud.points_W.size()); ++k) {
      hal::LaserProfile one(1);
      one.t_ns = profile.t_ns;
      one.X_WS.position_mm = profile.X_WS.position_mm;
      const Eigen::Vector3d to = cloud.points_W[k] - one.X_WS.position_mm;
      one.X_WS.orientation =
          Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), to.normalized());
      one.points.push_back({0, static_cast<float>(to.norm())});
      reconstruction.Add(one);
    }
  }
}

TEST(Registration, PassesThatDriftAreBroughtTogetherOnTheTube) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    const auto cloud = tests::ScanRealTube(
        FourBends(), {}, {.points = 8'000, .noise_mm = 0.03, .drift_mm = 0.1, .drift_deg = 0.02},
        random);
    ReconstructionOptions options;
    Reconstruction reconstruction(options, kClock);
    Feed(cloud, 4, reconstruction);
    const auto found = reconstruction.Finish();
    ASSERT_TRUE(found) << found.error().message;
    const auto& rows = found->tube.program.rows;
    ASSERT_EQ(rows.size(), 5U);
    ASSERT_EQ(found->passes.size(), 4U);
    EXPECT_LT(found->noise_mm, 0.04);  // that of the points, without what the passes do
    const bool reversed = std::abs(rows[0].angle_deg - 60) > 5;
    for (std::size_t i = 0; i < 4; ++i) {
      const std::size_t k = reversed ? 3 - i : i;
      const auto& sigma = found->sigma.rows[k];
      EXPECT_LT(std::abs(rows[k].angle_deg - cloud.truth.program.rows[i].angle_deg),
                4 * sigma.angle_deg);
      if (i == 0) continue;
      const std::size_t row = reversed ? 4 - i : i;
      EXPECT_LT(std::abs(rows[row].length_mm - cloud.truth.program.rows[i].length_mm),
                4 * found->sigma.rows[row].length_mm);
      EXPECT_LT(std::abs(hal::WrapRotationDeg(rows[row].rotation_deg -
                                              cloud.truth.program.rows[i].rotation_deg)),
                4 * found->sigma.rows[row].rotation_deg);
    }
    EXPECT_LT(std::abs(found->tube.pipe_radius_mm - 5), 5 * found->pipe_radius_sigma_mm);
  }
}

// What passes leave unknown of a bend that is hardly known was the difference of two large numbers:
// lengths beside it were told to be exact, and were 0.2 mm off.
TEST(Registration, NothingBesideASlightBendIsExact) {
  hal::Tube tube;
  tube.pipe_radius_mm = 17.2;
  tube.program.rows = {{100, 0, 120, 43.5}, {208, -116, 15, 43.5}, {41, 0, 0, {}}};
  for (unsigned seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    const auto cloud = tests::ScanRealTube(
        tube, {.ovality = 0.013},
        {.points = 20'000, .noise_mm = 0.03, .views = 5, .drift_mm = 0.05, .drift_deg = 0.02},
        random);
    ReconstructionOptions options;
    options.nominal = tube.program;
    Reconstruction reconstruction(options, kClock);
    Feed(cloud, 5, reconstruction);
    const auto found = reconstruction.Finish();
    ASSERT_TRUE(found) << found.error().message;
    ASSERT_EQ(found->tube.program.rows.size(), 3U);
    EXPECT_FALSE(found->passes.empty());
    const bool reversed = found->tube.program.rows[0].angle_deg < 60;
    const auto& sigma = found->sigma.rows;
    EXPECT_LT(
        std::abs(found->tube.program.rows[1].length_mm - cloud.truth.program.rows[1].length_mm),
        4 * sigma[1].length_mm);
    for (std::size_t i = 0; i < 2; ++i) {
      const double radius_mm = *found->tube.program.rows[reversed ? 1 - i : i].bend_radius_mm;
      EXPECT_LT(std::abs(radius_mm - 43.5), 4 * *sigma[reversed ? 1 - i : i].bend_radius_mm);
    }
  }
}

TEST(Registration, PassesThatMeetAreLeftWhereTheyAre) {
  std::mt19937_64 random(5);
  const auto cloud = tests::ScanRealTube(FourBends(), {}, {.points = 8'000}, random);
  ReconstructionOptions options;
  Reconstruction reconstruction(options, kClock);
  Feed(cloud, 4, reconstruction);
  const auto found = reconstruction.Finish();
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_TRUE(found->passes.empty());
}

TEST(Registration, ATubeThatWasMovedIsSaidToBe) {
  std::mt19937_64 random(6);
  auto cloud = tests::ScanRealTube(FourBends(), {}, {.points = 8'000}, random);
  for (std::size_t i = cloud.points_W.size() / 2; i < cloud.points_W.size(); ++i) {
    cloud.points_W[i] += Eigen::Vector3d(0.6, 0.6, 0.5);
  }
  ReconstructionOptions options;
  options.nominal = FourBends().program;
  Reconstruction reconstruction(options, kClock);
  Feed(cloud, 4, reconstruction);
  const auto found = reconstruction.Finish();
  ASSERT_TRUE(found) << found.error().message;
  const auto said = [&](const std::string& what) {
    return std::any_of(
        found->warnings.begin(), found->warnings.end(),
        [&](const std::string& warning) { return warning.find(what) != std::string::npos; });
  };
  EXPECT_TRUE(said("the tube was moved while it was scanned"));
}

}  // namespace
}  // namespace bendloop::pipeline
