// SPDX-License-Identifier: Apache-2.0
// Virtual scans of tubes whose wall is seen where it is cut: the flanks of holes and slots lie
// below the surface, and are no wall.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "drivers/simulated_scanner/virtual_scan.h"
#include "hal/clock.h"
#include "hal/tube_features.h"
#include "pipeline/reconstruction.h"
#include "tests/support/reversed_features.h"
#include "tests/unit/tube_features/measured_scan.h"

namespace bendloop::pipeline {
namespace {

struct WallScan {
  hal::Tube tube;
  drivers::VirtualScanOptions options;
};

// Lines 0.4 to 0.7 mm apart, in five passes.
WallScan AWallScan(std::uint64_t seed) {
  WallScan scan;
  scan.tube = drivers::LayOnTable(
      {12, {{{90, 0, 60, 35.0}, {70, 90, 45, 35.0}, {80, 0, 0, std::nullopt}}}, {}}, seed);
  scan.options.seed = seed;
  scan.options.noise_mm = 0.01 * static_cast<double>(1 + seed % 4);
  scan.options.fan_half_angle_deg = 8;
  scan.options.rays = 240;
  scan.options.path.profile_spacing_mm = 0.4 + 0.1 * static_cast<double>(seed % 4);
  scan.options.path.views_deg = drivers::SpreadViewsDeg(5, true);
  scan.options.path.jitter_mm = scan.options.path.jitter_deg = 0.1;
  scan.options.wall_mm = 1.0 + 0.5 * static_cast<double>(seed % 3);
  return scan;
}

// Errors of one number in sigmas.
class WallErrors {
 public:
  explicit WallErrors(std::string name) : name_(std::move(name)) {}
  ~WallErrors() {
    EXPECT_GT(count_, 0) << name_;
    EXPECT_LT(std::sqrt(squares_ / count_), 1.5) << name_;
  }
  void Add(double error, double sigma) {
    EXPECT_LT(std::abs(error), 4 * sigma) << name_;
    squares_ += std::pow(error / sigma, 2);
    count_ += 1;
  }

 private:
  std::string name_;
  double squares_ = 0, count_ = 0;
};

TEST(CutWall, HolesAndSlotsAreAsWideAsTheyAre) {
  WallErrors hole("diameter"), width("width"), length("length"), around("around");
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    SCOPED_TRACE(seed);
    WallScan scan = AWallScan(seed);
    const double turned = 47.0 * static_cast<double>(seed);
    const double hole_mm = 4.0 + 1.5 * static_cast<double>(seed % 6);
    scan.options.features.openings = {{40, std::remainder(turned, 360.0), hole_mm, hole_mm, 0},
                                      {158, std::remainder(2 * turned, 360.0), 15, 6, 30}};
    const Measurement m = MeasureScan(scan.tube, scan.options);
    ASSERT_EQ(m.features.openings.size(), 2U);
    // Whichever end came first.
    const bool is_reversed = std::abs(m.tube.program.rows.front().angle_deg - 45) < 5;
    const auto openings = is_reversed
                              ? tests::ReversedFeatures(scan.options.features, scan.tube).openings
                              : scan.options.features.openings;
    for (const OpeningFound& found : m.features.openings) {
      const auto truth_at =
          std::find_if(openings.begin(), openings.end(), [&](const hal::WallOpening& opening) {
            return opening.is_hole() == found.opening.is_hole();
          });
      ASSERT_NE(truth_at, openings.end());
      const hal::WallOpening& truth = *truth_at;
      EXPECT_EQ(found.opening.lean_along_deg, 0);
      around.Add(std::remainder(found.opening.around_deg - truth.around_deg, 360.0),
                 found.sigma.around_deg);
      if (truth.is_hole()) {
        hole.Add(found.opening.width_mm - truth.width_mm, found.sigma.width_mm);
      } else {
        width.Add(found.opening.width_mm - truth.width_mm, found.sigma.width_mm);
        length.Add(found.opening.length_mm - truth.length_mm, found.sigma.length_mm);
      }
    }
    EXPECT_TRUE(m.dents.empty());
    EXPECT_FALSE(m.features.first_end && m.features.first_end->bevel);
    EXPECT_FALSE(m.features.last_end && m.features.last_end->bevel);
  }
}

}  // namespace
}  // namespace bendloop::pipeline
