// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/nominal_die.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "hal/clock.h"
#include "pipeline/reconstruction.h"
#include "tests/support/real_tube.h"

namespace bendloop::pipeline {
namespace {

const hal::SteadyClock kDieClock;

hal::Tube OneBend(double angle_deg, double bend_radius_mm) {
  hal::Tube tube;
  tube.pipe_radius_mm = 9;
  tube.program.rows = {{75, 0, angle_deg, bend_radius_mm}, {60, 0, 0, {}}};
  return tube;
}

Measurement Measured(const hal::Tube& tube, double easing_r, const hal::BendProgram& nominal,
                     std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const auto scan = tests::ScanRealTube(tube, {.easing_r = easing_r},
                                        {.points = 24'000, .noise_mm = 0.1}, random);
  ReconstructionOptions options;
  options.nominal = nominal;
  auto found = Reconstruct(scan.points_W, options, kDieClock);
  EXPECT_TRUE(found.has_value());
  return found ? std::move(*found) : Measurement{};
}

double RadiusMm(const Measurement& m) {
  return m.tube.program.rows[0].bend_radius_mm.value_or(0.0);
}
double RadiusSigmaMm(const Measurement& m) { return m.sigma.rows[0].bend_radius_mm.value_or(0.0); }

// A sharp one of 33 mm explains these points as well: 5 to 7 sigma off before.
TEST(NominalDie, TellsArcAndEasingOfOneBendApart) {
  constexpr double kEased = 0.15;  // [of r_P]
  const hal::Tube tube = OneBend(25, 31.6);
  for (const std::uint64_t seed : {2U, 3U, 5U, 6U}) {
    SCOPED_TRACE(seed);
    const Measurement m = Measured(tube, kEased, tube.program, seed);
    ASSERT_EQ(m.tube.program.bend_count(), 1U);
    EXPECT_LT(std::abs(RadiusMm(m) - 31.6), 3.5 * RadiusSigmaMm(m));
    EXPECT_LT(RadiusSigmaMm(m), 0.03 * 31.6);
    const auto &rows = m.tube.program.rows, &sigma = m.sigma.rows;
    const double both_mm = rows[0].length_mm + rows[1].length_mm;
    EXPECT_LT(std::abs(both_mm - 135), 3.5 * (sigma[0].length_mm + sigma[1].length_mm));
  }
}

// It was 9 +- 18 mm without the nominal.
TEST(NominalDie, TellsTheArcOfABendThatEasesFurtherThanItIsLong) {
  const hal::Tube tube = OneBend(25, 31.6);
  const Measurement m = Measured(tube, 0.25, tube.program, 4);
  EXPECT_LT(std::abs(RadiusMm(m) - 31.6), 3.5 * RadiusSigmaMm(m));
  EXPECT_LT(RadiusSigmaMm(m), 0.06 * 31.6);
}

// Where the points know better the nominal's radius is none: sharp bends that sprang back.
TEST(NominalDie, IsNotTheNominalsWherePointsContradictIt) {
  const hal::Tube tube = OneBend(95, 33.0);
  const hal::Tube nominal = OneBend(97, 31.6);
  for (const std::uint64_t seed : {1U, 2U}) {
    SCOPED_TRACE(seed);
    const Measurement m = Measured(tube, 0, nominal.program, seed);
    EXPECT_LT(std::abs(RadiusMm(m) - 33.0), 3.5 * RadiusSigmaMm(m));
    EXPECT_LT(RadiusSigmaMm(m), 0.01 * 33.0);
  }
}

}  // namespace
}  // namespace bendloop::pipeline
