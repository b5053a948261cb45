// SPDX-License-Identifier: Apache-2.0
// How many bends there are is no close call where only the search finds it one, which knows neither
// bows nor easing.
#include <gtest/gtest.h>

#include <cstdint>
#include <random>

#include "hal/clock.h"
#include "pipeline/reconstruction.h"
#include "tests/support/real_tube.h"

namespace bendloop::pipeline {
namespace {

hal::Tube TwoBends() {
  hal::Tube tube;
  tube.pipe_radius_mm = 8;
  tube.program.rows = {{60, 0, 120, 20}, {75, 110, 63, 20}, {58, 0, 0, {}}};
  return tube;
}

// A scan whose part the nominal is was held as a close call.
TEST(SearchMargin, OfBendsThatEaseIsNoCloseCallOnceThatIsKnown) {
  const hal::SteadyClock clock;
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    const auto cloud = tests::ScanRealTube(
        TwoBends(), {.bow = 1.0 / 900, .easing_r = 0.9},
        {.points = 30'000, .noise_mm = 0.02, .drift_mm = 0.06, .drift_deg = 0.012}, random);
    ReconstructionOptions options;
    options.nominal = TwoBends().program;
    const auto measured = Reconstruct(cloud.points_W, options, clock);
    ASSERT_TRUE(measured) << measured.error().message;
    EXPECT_EQ(measured->tube.program.bend_count(), 2U);
    EXPECT_GT(measured->structure_margin, 10);
  }
}

}  // namespace
}  // namespace bendloop::pipeline
