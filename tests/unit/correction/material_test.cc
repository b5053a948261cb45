// SPDX-License-Identifier: Apache-2.0
#include "pipeline/correction/material.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <numbers>

namespace bendloop::pipeline {
namespace {

using ::testing::HasSubstr;

TEST(Material, SpringsBackLinearlyThroughTheTwoGivenAngles) {
  const Material material{1.0, 4.0, 0};
  EXPECT_NEAR(material.SpringbackDeg(20), 1.0, 1e-12);
  EXPECT_NEAR(material.SpringbackDeg(120), 4.0, 1e-12);
  EXPECT_NEAR(material.SpringbackDeg(70), 2.5, 1e-12);
  EXPECT_EQ(material.SpringbackDeg(0), 0);
  EXPECT_NEAR(material.AngleAfterDeg(120), 116, 1e-12);
  EXPECT_NEAR(material.AngleToCommandDeg(116), 120, 1e-12);
  EXPECT_NEAR(material.AngleSlope(), 0.97, 1e-12);
}

TEST(Material, StretchesBothStraightsBesideABend) {
  const Material material{0, 0, 4.0};
  const double arc_mm = 50 * std::numbers::pi / 2;
  EXPECT_NEAR(material.StretchOfStraightMm(50, 90), 0.02 * arc_mm, 1e-12);
  const hal::BendProgram commanded{
      {{100, 0, 90, 50.0}, {60, 30, 90, 50.0}, {80, 0, 0, std::nullopt}}};
  const hal::BendProgram bent = PredictBent(commanded, material);
  EXPECT_NEAR(bent.rows[0].length_mm, 100 + 0.02 * arc_mm, 1e-12);
  EXPECT_NEAR(bent.rows[1].length_mm, 60 + 0.04 * arc_mm, 1e-12);
  EXPECT_NEAR(bent.rows[2].length_mm, 80 + 0.02 * arc_mm, 1e-12);
}

TEST(Material, TheFirstProgramNeverHasANegativeStraight) {
  const hal::BendProgram nominal{{{100, 0, 90, 50.0}, {0, 30, 90, 50.0}, {80, 0, 0, std::nullopt}}};
  const auto program = InitialProgram(nominal, {1, 3, 5});
  ASSERT_TRUE(program);
  EXPECT_EQ(program->rows[1].length_mm, 0);
  EXPECT_EQ(program->rows[1].rotation_deg, 30);
  EXPECT_EQ(program->rows[1].bend_radius_mm, 50.0);
}

TEST(Material, RefusesWhatNoBenderBends) {
  EXPECT_FALSE(Check({0, 60, 0}));
  EXPECT_FALSE(Check({std::numeric_limits<double>::quiet_NaN(), 0, 0}));
  EXPECT_FALSE(Check({0, 0, 40}));
  EXPECT_THAT(Check({50, 50, 0}).error().message, HasSubstr("degrees, not percent"));
  // A springback that turns into its opposite at small angles.
  const auto program =
      InitialProgram({{{10, 0, 1, 30.0}, {10, 0, 0, std::nullopt}}}, {-5.0, 0.0, 0.0});
  ASSERT_FALSE(program);
  EXPECT_THAT(program.error().message, HasSubstr("bend 1 angle"));
}

}  // namespace
}  // namespace bendloop::pipeline
