// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/wrinkles.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <optional>
#include <random>
#include <vector>

#include "hal/spine.h"
#include "pipeline/fit/wrinkle_fit.h"
#include "pipeline/reconstruction.h"
#include "tests/support/real_tube.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

hal::Tube OneDie() {
  hal::Tube tube = ThreeBends();
  for (std::size_t i = 0; i < 3; ++i) tube.program.rows[i].bend_radius_mm = 15;
  return tube;
}

Measurement Measured(const tests::Form& form, const tests::RealScan& scan, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const auto cloud = tests::ScanRealTube(OneDie(), form, scan, random);
  auto found = Reconstruct(cloud.points_W, {}, kClock);
  EXPECT_TRUE(found.has_value());
  return found ? std::move(*found) : Measurement{};
}

TEST(Wrinkles, AreToldAndPullNoRadius) {
  constexpr double kHeight = 0.012;  // [of r_P] above the wall, half of crest to trough
  double squares = 0, values = 0;
  for (const std::uint64_t seed : {1U, 2U, 3U, 4U}) {
    SCOPED_TRACE(seed);
    const Measurement m =
        Measured({.wrinkles = kHeight}, {.points = 60'000, .noise_mm = 0.01}, seed);
    ASSERT_EQ(m.wrinkles.size(), 3U);
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_EQ(m.wrinkles[i].bend, i);
      EXPECT_NEAR(m.wrinkles[i].height_mm, 2 * kHeight * 5, 3 * m.wrinkles[i].sigma_mm);
      EXPECT_LT(m.wrinkles[i].sigma_mm, 0.04);
      squares += std::pow(
          (*m.tube.program.rows[i].bend_radius_mm - 15) / *m.sigma.rows[i].bend_radius_mm, 2);
      values += 1;
    }
  }
  EXPECT_LT(std::sqrt(squares / values), 1.6);
}

// However long waves and their bend are: what is even along a piece of a bend took in a part of
// waves about as long.
TEST(Waves, AreAsHighAsTheySay) {
  constexpr int kEach = 60;
  constexpr double kPipeRadiusMm = 5, kNoiseMm = 0.03;
  std::mt19937_64 random(5);
  const auto uniform = [&](double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(random);
  };
  std::normal_distribution<double> noise(0, kNoiseMm);
  double squares = 0, ratio = 0;
  for (int i = 0; i < kEach; ++i) {
    const double length_mm = kPipeRadiusMm * uniform(3, 10);
    const double wave_mm = kPipeRadiusMm * uniform(0.4, 1.2), phase = uniform(0, 6);
    const double height_mm = uniform(0.06, 0.3), oval_mm = uniform(-0.1, 0.1);
    std::vector<BendSample> samples(static_cast<std::size_t>(60 * length_mm));
    for (BendSample& sample : samples) {
      sample = {uniform(0, length_mm), uniform(-std::numbers::pi, std::numbers::pi)};
      const double inner = std::max(0.0, std::cos(sample.around_rad));
      const double turn = 2 * std::numbers::pi * sample.along_mm / wave_mm + phase;
      sample.off_mm = 0.5 * height_mm * inner * inner * std::cos(turn) +
                      oval_mm * std::cos(2 * sample.around_rad) *
                          std::sin(std::numbers::pi * sample.along_mm / length_mm) +
                      noise(random);
    }
    const auto waves = FitWaves(samples, length_mm, kPipeRadiusMm, height_mm, kNoiseMm);
    ASSERT_TRUE(waves);
    squares += std::pow((waves->height_mm - height_mm) / waves->sigma_mm, 2) / kEach;
    ratio += waves->height_mm / height_mm / kEach;
  }
  EXPECT_LT(std::sqrt(squares), 1.2);
  EXPECT_NEAR(ratio, 1.0, 0.05);
}

TEST(Wrinkles, AreNoneWhereBendsAreOtherwiseNotAsTheModelHasThem) {
  const tests::RealScan fine{.points = 60'000, .noise_mm = 0.01};
  for (const std::uint64_t seed : {1U, 2U}) {
    SCOPED_TRACE(seed);
    EXPECT_THAT(Measured({}, fine, seed).wrinkles, testing::IsEmpty());
    EXPECT_THAT(Measured({.easing_r = 0.8}, fine, seed).wrinkles, testing::IsEmpty());
    EXPECT_THAT(Measured({.bow = 0.002, .easing_r = 0.3}, fine, seed).wrinkles, testing::IsEmpty());
    EXPECT_THAT(Measured({.ovality = 0.08}, fine, seed).wrinkles, testing::IsEmpty());
    EXPECT_THAT(Measured({}, {.heavy_tail = 0.7}, seed).wrinkles, testing::IsEmpty());
    EXPECT_THAT(Measured({}, {.drift_mm = 0.2, .drift_deg = 0.02}, seed).wrinkles,
                testing::IsEmpty());
  }
}

// Troughs of waves are as deep as small dents are.
TEST(Wrinkles, AreNoDents) {
  for (const double noise_mm : {0.03, 0.05}) {
    for (const std::uint64_t seed : {1U, 2U, 3U}) {
      SCOPED_TRACE(seed);
      const tests::RealScan scan{.points = 60'000, .noise_mm = noise_mm};
      EXPECT_THAT(Measured({.wrinkles = 0.012}, scan, seed).dents, testing::IsEmpty());
      EXPECT_THAT(Measured({.wrinkles = 0.03}, scan, seed).dents, testing::IsEmpty());
      EXPECT_THAT(Measured({.ovality = 0.08, .wrinkles = 0.02}, scan, seed).dents,
                  testing::IsEmpty());
    }
  }
}

TEST(Wrinkles, AreHardlyEverTakenForEasingsOfOvalBends) {
  int told = 0;
  for (const double noise_mm : {0.01, 0.05}) {
    for (const std::uint64_t seed : {1U, 2U, 3U, 4U}) {
      const tests::RealScan scan{.points = 60'000, .noise_mm = noise_mm};
      told += Measured({.easing_r = 0.8, .ovality = 0.08}, scan, seed).wrinkles.empty() ? 0 : 1;
      told += Measured({.easing_r = 0.5, .ovality = 0.05}, scan, seed).wrinkles.empty() ? 0 : 1;
    }
  }
  EXPECT_LE(told, 1);
}

// In the middle of the first bend, on its innermost line.
TEST(Wrinkles, ADentOnTheInnerSideIsADent) {
  const double along = (45 + 15 * std::numbers::pi / 6) / hal::SpineLength(OneDie().program);
  for (const double width_r : {0.3, 0.8}) {
    for (const std::uint64_t seed : {1U, 2U, 3U, 4U}) {
      SCOPED_TRACE(seed);
      const Measurement m = Measured(
          {.dents = {{.along = along, .around_rad = 0, .depth_r = 0.1, .width_r = width_r}}},
          {.points = 60'000, .noise_mm = 0.01}, seed);
      EXPECT_THAT(m.wrinkles, testing::IsEmpty());
      EXPECT_THAT(m.dents, testing::Not(testing::IsEmpty())) << width_r;
    }
  }
}

TEST(Wrinkles, AreOfTheBendsThatAreThere) {
  const hal::Tube tube = OneDie();
  WrinklesFound of{5, 0.1, 0.02, hal::SpineSegments(tube.program, tube.X_WT)[3].PointAt(4)};
  std::vector<WrinklesFound> wrinkles = {of, of};
  wrinkles.push_back({0, 0.1, 0.02, {1e3, 0, 0}});
  KeepThoseOf(tube, {}, wrinkles);
  ASSERT_EQ(wrinkles.size(), 1U);
  EXPECT_EQ(wrinkles.front().bend, 1U);
  KeepThoseOf({5, {{{100, 0, 0, std::nullopt}}}, {}}, {}, wrinkles);
  EXPECT_THAT(wrinkles, testing::IsEmpty());
}

// Of a thousand points nobody can tell.
TEST(Wrinkles, OfFewPointsAreNotSought) {
  EXPECT_THAT(Measured({.wrinkles = 0.012}, {.points = 1'500}, 1).wrinkles, testing::IsEmpty());
}

}  // namespace
}  // namespace bendloop::pipeline
