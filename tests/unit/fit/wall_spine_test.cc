// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/wall_spine.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "hal/angles.h"
#include "hal/spine.h"
#include "pipeline/reconstruction.h"
#include "tests/support/real_tube.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

// The best-fit lines of its straights pass each other by millimetres beside the second bend.
hal::Tube BentFarBack() {
  hal::Tube tube;
  tube.pipe_radius_mm = 13.6;
  tube.program.rows = {
      {100, 0, 70, 38}, {150, -103, 97, 38}, {60, 85, 143, 38}, {107, 58, 98, 38}, {90, 0, 0, {}}};
  return tube;
}

Measurement MeasuredScan(const tests::Form& form, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const auto cloud =
      tests::ScanRealTube(BentFarBack(), form, {.points = 60'000, .noise_mm = 0.02}, random);
  const auto measured = Reconstruct(cloud.points_W, {}, kClock);
  EXPECT_TRUE(measured);
  return measured.value_or(Measurement{});
}

// Two points of three were told to be no points of the tube, and what is left of it a scrap.
TEST(WallSpine, OfATubeThatBowsIsWhereItsPointsAre) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    SCOPED_TRACE(seed);
    const Measurement m = MeasuredScan({.bow = 1.0 / 900}, seed);
    ASSERT_EQ(m.tube.program.bend_count(), 4U);
    EXPECT_LT(m.fit.outliers, 3000U);
    for (const std::string& warning : m.warnings) {
      EXPECT_EQ(warning.find("do not lie on it"), std::string::npos) << warning;
    }
  }
}

// About the axis of the tube of its corners, which lies beside that of the wall, dents pressed in
// from two sides are up to 1.3 degrees nearer to each other one way around than the other.
TEST(WallSpine, IsWhatPlacesAroundAreCountedAbout) {
  const hal::Tube tube = BentFarBack();
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const double length_mm = hal::SpineLength(tube.program);
  for (const std::size_t straight : {std::size_t{2}, std::size_t{6}}) {
    const double along_mm = segments[straight].from_start_mm + 0.5 * segments[straight].length_mm;
    for (std::uint64_t seed = 1; seed <= 4; ++seed) {
      SCOPED_TRACE(testing::Message() << "straight " << straight / 2 + 1 << ", seed " << seed);
      const double around_rad = 0.7 * static_cast<double>(seed);
      tests::Dent one{along_mm / length_mm, around_rad, 0.1, 0.4};
      tests::Dent across = one;
      across.around_rad += std::numbers::pi;
      const Measurement m = MeasuredScan({.bow = 1.0 / 900, .dents = {one, across}}, seed);
      ASSERT_EQ(m.dents.size(), 2U);
      const double off_deg =
          hal::WrapRotationDeg(m.dents[0].around_deg - m.dents[1].around_deg - 180.0);
      EXPECT_LT(std::abs(off_deg),
                4 * std::hypot(m.dents[0].around_sigma_deg, m.dents[1].around_sigma_deg));
      EXPECT_LT(std::abs(off_deg), 0.3);
    }
  }
}

}  // namespace
}  // namespace bendloop::pipeline
