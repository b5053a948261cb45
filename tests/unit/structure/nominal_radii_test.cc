// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/nominal_radii.h"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <random>

#include "hal/clock.h"
#include "pipeline/reconstruction.h"
#include "pipeline/tube/representations.h"
#include "tests/support/synthetic_cloud.h"

namespace bendloop::pipeline {
namespace {

hal::Tube OfTwoDies() {
  hal::Tube tube;
  tube.pipe_radius_mm = 5;
  tube.program.rows = {
      {80, 0, 64, 22}, {70, 30, 2.5, 48}, {90, 120, 60, 22}, {70, -75, 75, 22}, {80, 0, 0, {}}};
  return tube;
}

Measurement Measured(const std::optional<hal::BendProgram>& nominal, unsigned seed) {
  std::mt19937_64 random(seed);
  const hal::SteadyClock clock;
  const auto cloud =
      tests::SyntheticCloud(OfTwoDies(), {.points = 12'000, .noise_mm = 0.05}, random);
  ReconstructionOptions options;
  options.nominal = nominal;
  auto measured = Reconstruct(cloud, options, clock);
  if (!measured) {
    ADD_FAILURE() << measured.error().message;
    return {};
  }
  return *measured;
}

// Of the slight bend, the second from either end.
hal::BendRow SlightBend(const Measurement& measured) {
  const auto& rows = measured.tube.program.rows;
  if (rows.size() != 5) return {};
  return rows[1].angle_deg < rows[2].angle_deg ? rows[1] : rows[2];
}

TEST(NominalRadii, ASlightBendHasTheRadiusThatItsNominalSays) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    for (const bool reversed : {false, true}) {
      SCOPED_TRACE(testing::Message() << seed << ' ' << reversed);
      hal::BendProgram nominal = OfTwoDies().program;
      for (hal::BendRow& row : nominal.rows) {
        if (row.bend_radius_mm) *row.bend_radius_mm *= 0.98;  // springback opens all alike
      }
      if (reversed) nominal = ReverseProgram(nominal);
      EXPECT_NEAR(SlightBend(Measured(nominal, seed)).bend_radius_mm.value_or(0), 48, 3);
      EXPECT_NEAR(SlightBend(Measured({}, seed)).bend_radius_mm.value_or(0), 22, 2);
    }
  }
}

// The corner stays, and with it what straights are long by the radii.
TEST(NominalRadii, LengthsAreThoseOfTheRadius) {
  const auto& truth = OfTwoDies().program.rows;
  for (const unsigned seed : {4U, 5U, 6U}) {
    SCOPED_TRACE(seed);
    const Measurement measured = Measured(OfTwoDies().program, seed);
    const auto& rows = measured.tube.program.rows;
    ASSERT_EQ(rows.size(), truth.size());
    const bool is_reversed = rows[1].angle_deg > 10;
    for (std::size_t i = 1; i + 1 < rows.size(); ++i) {
      const std::size_t k = is_reversed ? rows.size() - 1 - i : i;
      EXPECT_LT(std::abs(rows[k].length_mm - truth[i].length_mm),
                4 * measured.sigma.rows[k].length_mm)
          << i;
    }
  }
}

// Samples that know a radius keep it.
TEST(NominalRadii, MovesNoRadiusThatSamplesKnow) {
  hal::BendProgram nominal = OfTwoDies().program;
  nominal.rows[2].bend_radius_mm = 30;
  nominal.rows[2].length_mm -= 8 * std::tan(0.5 * 60 * 3.14159265 / 180);
  nominal.rows[3].length_mm -= 8 * std::tan(0.5 * 60 * 3.14159265 / 180);
  const Measurement measured = Measured(nominal, 1);
  for (const hal::BendRow& row : measured.tube.program.rows) {
    if (row.angle_deg > 55 && row.angle_deg < 62) {
      EXPECT_NEAR(row.bend_radius_mm.value_or(0), 22, 0.5);
    }
  }
}

}  // namespace
}  // namespace bendloop::pipeline
