// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/nominal_die.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "hal/clock.h"
#include "pipeline/reconstruction.h"
#include "tests/support/real_tube.h"
#include "tests/support/uniform.h"

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

bool SaysOtherDie(const Measurement& m) {
  return std::any_of(m.warnings.begin(), m.warnings.end(), [](const std::string& warning) {
    return warning.find("which die is mounted") != std::string::npos;
  });
}

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

// Another die was mounted than the nominal has: what samples hardly tell from easing is as unsure
// as that, and not the nominal's. 15 sigma off before.
TEST(NominalDie, IsNotTheNominalsWhereAnotherDieIsMounted) {
  std::mt19937_64 random(1);
  double square = 0;
  int count = 0, told = 0;
  for (int i = 0; i < 16; ++i) {
    SCOPED_TRACE(i);
    hal::Tube tube;
    tube.pipe_radius_mm = 9;
    const double radius_mm = tests::Uniform(random, 22, 40);
    const std::size_t bends = 1 + static_cast<std::size_t>(i % 3);
    for (std::size_t b = 0; b < bends; ++b) {
      const double rotation_deg = b == 0 ? 0.0 : tests::Uniform(random, -150, 150);
      tube.program.rows.push_back(
          {tests::Uniform(random, 60, 90), rotation_deg, tests::Uniform(random, 8, 40), radius_mm});
    }
    tube.program.rows.push_back({70, 0, 0, {}});
    hal::BendProgram nominal = tube.program;
    for (std::size_t b = 0; b < bends; ++b) *nominal.rows[b].bend_radius_mm *= 0.75;
    const Measurement m = Measured(tube, 0, nominal, 10 + static_cast<std::uint64_t>(i));
    ASSERT_EQ(m.tube.program.bend_count(), bends);
    // What the samples do not tell is the nominal's, and a person is told.
    if (SaysOtherDie(m)) {
      ++told;
      continue;
    }
    for (std::size_t b = 0; b < bends; ++b) {
      const double off = (m.tube.program.rows[b].bend_radius_mm.value_or(0.0) - radius_mm) /
                         m.sigma.rows[b].bend_radius_mm.value_or(0.0);
      EXPECT_LT(std::abs(off), 4);
      square += off * off;
      ++count;
    }
  }
  EXPECT_LT(std::sqrt(square / count), 1.5);
  EXPECT_LT(told, 8);
}

// A person is told of radii that are another die's, and of none that sprang back.
TEST(OtherPart, IsSaidOfAnotherDie) {
  for (const double nominal_mm : {26.4, 31.6, 41.0}) {
    SCOPED_TRACE(nominal_mm);
    const hal::Tube tube = OneBend(95, 33.0), nominal = OneBend(97, nominal_mm);
    const Measurement m = Measured(tube, 0, nominal.program, 1);
    const bool is_told =
        std::any_of(m.warnings.begin(), m.warnings.end(), [](const std::string& warning) {
          return warning.find("another die is mounted") != std::string::npos;
        });
    EXPECT_EQ(is_told, std::abs(nominal_mm / 33.0 - 1.0) > 0.1);
  }
}

}  // namespace
}  // namespace bendloop::pipeline
