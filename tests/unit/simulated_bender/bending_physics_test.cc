// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_bender/bending_physics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "tests/support/bender_maps.h"

namespace bendloop::drivers {
namespace {

// Developed length: straights and arcs.
double LengthMm(const hal::BendProgram& program) {
  double length = 0;
  for (const hal::BendRow& row : program.rows) {
    length +=
        row.length_mm + row.bend_radius_mm.value_or(0) * row.angle_deg * std::numbers::pi / 180;
  }
  return length;
}

TEST(BendingPhysics, NothingSetBendsAsCommanded) {
  std::mt19937_64 random(1);
  for (int i = 0; i < 50; ++i) {
    const hal::BendProgram program = test::RandomProgram(random, 5);
    EXPECT_EQ(BendTube(program, {}, 1), program);
  }
}

TEST(BendingPhysics, SpringbackIsLinearThroughItsTwoValues) {
  BendingPhysics physics;
  physics.springback_20_deg = 0.8;
  physics.springback_120_deg = 3.1;
  EXPECT_NEAR(SpringbackDeg(physics, 20), 0.8, 1e-12);
  EXPECT_NEAR(SpringbackDeg(physics, 120), 3.1, 1e-12);
  EXPECT_NEAR(SpringbackDeg(physics, 70), 1.95, 1e-12);
  EXPECT_EQ(SpringbackDeg(physics, 0), 0);
  const hal::BendProgram program{{{50, 0, 70, 30}, {60, 40, 0.1, 30}, {70, 0, 0, {}}}};
  const hal::BendProgram tube = BendTube(program, physics, 1);
  EXPECT_NEAR(tube.rows[0].angle_deg, 68.05, 1e-12);
  EXPECT_EQ(tube.rows[1].angle_deg, 0);  // springs back wholly, never negative
  EXPECT_EQ(tube.rows[2], program.rows[2]);
}

TEST(BendingPhysics, ElongationLengthensTheNeighboursOfEachBend) {
  BendingPhysics physics;
  physics.elongation_percent = 4;
  const hal::BendProgram program{{{50, 0, 90, 100}, {60, 40, 45, 50}, {70, 0, 0, {}}}};
  const hal::BendProgram tube = BendTube(program, physics, 1);
  const double first = 0.04 * 100 * std::numbers::pi / 2;
  const double second = 0.04 * 50 * std::numbers::pi / 4;
  EXPECT_NEAR(tube.rows[0].length_mm, 50 + first / 2, 1e-12);
  EXPECT_NEAR(tube.rows[1].length_mm, 60 + first / 2 + second / 2, 1e-12);
  EXPECT_NEAR(tube.rows[2].length_mm, 70 + second / 2, 1e-12);
  EXPECT_NEAR(LengthMm(tube), LengthMm(program) + first + second, 1e-9);
}

TEST(BendingPhysics, TwistAndSpringOut) {
  BendingPhysics physics;
  physics.twist_deg = 2;
  physics.radius_spring_out = 0.01;
  const hal::BendProgram program{
      {{50, 0, 90, 100}, {60, 179, 45, 50}, {60, 10, 45, 50}, {70, 0, 0, {}}}};
  const hal::BendProgram tube = BendTube(program, physics, 1);
  EXPECT_EQ(tube.rows[0].rotation_deg, 0);
  EXPECT_NEAR(tube.rows[1].rotation_deg, -179, 1e-9);
  EXPECT_NEAR(tube.rows[2].rotation_deg, 12, 1e-9);
  EXPECT_EQ(tube.rows[3].rotation_deg, 0);
  EXPECT_NEAR(tube.rows[0].bend_radius_mm.value(), 101, 1e-9);
  EXPECT_FALSE(tube.rows[3].bend_radius_mm);
}

TEST(BendingPhysics, ScatterIsSeededPerPartAndHasItsSigma) {
  BendingPhysics physics;
  physics.sigma_angle_deg = 0.1;
  physics.sigma_rotation_deg = 0.2;
  physics.sigma_length_mm = 0.3;
  const hal::BendProgram program{{{50, 0, 90, 100}, {60, 40, 45, 50}, {70, 0, 0, {}}}};
  EXPECT_EQ(BendTube(program, physics, 3), BendTube(program, physics, 3));
  EXPECT_NE(BendTube(program, physics, 3), BendTube(program, physics, 4));
  BendingPhysics other = physics;
  other.seed = 2;
  EXPECT_NE(BendTube(program, physics, 3), BendTube(program, other, 3));

  constexpr std::uint32_t kParts = 20000;
  double sum[3] = {};
  double squares[3] = {};
  for (std::uint32_t part = 1; part <= kParts; ++part) {
    const hal::BendRow row = BendTube(program, physics, part).rows[1];
    const double errors[] = {row.angle_deg - 45, row.rotation_deg - 40, row.length_mm - 60};
    for (int i = 0; i < 3; ++i) {
      sum[i] += errors[i];
      squares[i] += errors[i] * errors[i];
    }
  }
  const double sigmas[] = {0.1, 0.2, 0.3};
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(sum[i] / kParts, 0, 5 * sigmas[i] / std::sqrt(kParts));
    EXPECT_NEAR(std::sqrt(squares[i] / kParts), sigmas[i], 0.03 * sigmas[i]);
  }
}

TEST(BendingPhysics, DefaultRadiusServesProgramsWithoutOne) {
  BendingPhysics physics;
  physics.default_bend_radius_mm = 42;
  const hal::BendProgram tube = BendTube({{{50, 0, 90, {}}, {70, 0, 0, {}}}}, physics, 1);
  EXPECT_EQ(tube.rows[0].bend_radius_mm, 42);
  EXPECT_FALSE(tube.rows[1].bend_radius_mm);
}

TEST(BendingPhysics, ImpossibleSettingsAreRefused) {
  BendingPhysics physics;
  EXPECT_TRUE(CheckBendingPhysics(physics));
  physics.sigma_angle_deg = -1;
  const auto checked = CheckBendingPhysics(physics);
  ASSERT_FALSE(checked);
  EXPECT_EQ(checked.error().message, "--scatter-angle: found -1, expected 0 to 10");
  physics.sigma_angle_deg = std::nan("");
  EXPECT_FALSE(CheckBendingPhysics(physics));
}

}  // namespace
}  // namespace bendloop::drivers
