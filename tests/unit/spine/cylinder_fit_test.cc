// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/cylinder_fit.h"

#include <gtest/gtest.h>

#include "tests/support/shapes.h"

namespace bendloop::pipeline {
namespace {

using tests::kPi;
using tests::Points;
using tests::Random;
using tests::Uniform;

CylinderFitOptions Options(double radius, bool free_radius) {
  return {.radius_mm = radius,
          .free_radius = free_radius,
          .support_mm = 1.4 * radius,
          .inlier_mm = 0.25 * radius,
          .max_iterations = 40};
}

TEST(CylinderFit, RecoversAxisAndRadiusFromAWrongGuess) {
  Random random(1);
  for (int run = 0; run < 40; ++run) {
    const double r = Uniform(random, 1, 30);
    const bool free_radius = run % 2 == 0;
    const hal::Pose pose = tests::RandomPose(200, random);
    const Points points = tests::Moved(tests::CylinderPoints(r, 2 * r, 1500, random), pose);
    const Eigen::Vector3d axis = pose.orientation * Eigen::Vector3d::UnitZ();
    const Eigen::Vector3d guess_point = pose.position_mm + 0.25 * r * tests::RandomUnit(random);
    const Eigen::Vector3d guess_axis = (axis + 0.2 * tests::RandomUnit(random)).normalized();
    const double guess_radius = free_radius ? r * Uniform(random, 0.9, 1.1) : r;
    const auto fit =
        FitCylinder(guess_point, guess_axis, points, Options(guess_radius, free_radius));
    ASSERT_TRUE(fit) << run;
    EXPECT_NEAR(fit->radius_mm / r, 1, 1e-6) << run;
    EXPECT_NEAR(fit->axis.dot(axis), 1, 1e-10) << run;
    const Eigen::Vector3d off = fit->point_mm - pose.position_mm;
    EXPECT_NEAR((off - off.dot(axis) * axis).norm() / r, 0, 1e-5) << run;
    // The foot of the first guess, not some other point of the axis.
    EXPECT_NEAR((fit->point_mm - guess_point).dot(axis) / r, 0, 1e-5) << run;
    EXPECT_NEAR(fit->rms_mm / r, 0, 1e-5) << run;
    EXPECT_DOUBLE_EQ(fit->angular_coverage, 1) << run;
    EXPECT_GT(fit->axial_spread_mm, 0.2 * r) << run;
  }
}

TEST(CylinderFit, NoiseHardlyBiasesTheRadius) {
  Random random(2);
  double sum = 0;
  for (int run = 0; run < 60; ++run) {
    const Points points = tests::CylinderPoints(4, 6, 2000, random, 0.1);
    const auto fit = FitCylinder({0, 0, 0}, {0, 0, 1}, points, Options(4, true));
    ASSERT_TRUE(fit);
    sum += fit->radius_mm - 4;
    EXPECT_NEAR(fit->rms_mm, 0.1, 0.02);
  }
  EXPECT_NEAR(sum / 60, 0, 0.02);
}

TEST(CylinderFit, OutliersAreLeftAlone) {
  Random random(3);
  for (int run = 0; run < 20; ++run) {
    Points points = tests::CylinderPoints(4, 8, 1500, random, 0.02);
    for (int i = 0; i < 300; ++i) {
      points.emplace_back(Uniform(random, -8, 8), Uniform(random, -8, 8), Uniform(random, -8, 8));
    }
    const auto fit = FitCylinder({0.5, 0, 0}, Eigen::Vector3d(0.1, 0, 1).normalized(), points,
                                 Options(4, run % 2 == 0));
    ASSERT_TRUE(fit);
    EXPECT_NEAR(fit->radius_mm, 4, 0.03);
    EXPECT_LT(fit->point_mm.head<2>().norm(), 0.04);
    EXPECT_GT(fit->axis.z(), 0.9998);
  }
}

TEST(CylinderFit, CoverageIsThePartOfTheTurnThatWasSeen) {
  Random random(4);
  for (const double part : {0.3, 0.5, 0.75, 1.0}) {
    const Points points = tests::CylinderPoints(4, 8, 4000, random, 0, 0.4, 0.4 + part * 2 * kPi);
    const auto fit = FitCylinder({0.1, 0, 0}, {0, 0, 1}, points, Options(4, false));
    ASSERT_TRUE(fit);
    EXPECT_NEAR(fit->angular_coverage, part, 0.08);
    EXPECT_LT(fit->point_mm.head<2>().norm(), 1e-4) << "one-sided points determine the axis too";
  }
}

TEST(CylinderFit, AStripeHasNoSpreadAlongTheAxis) {
  Random random(5);
  Points points = tests::CylinderPoints(4, 0.05, 400, random);
  const auto fit = FitCylinder({0, 0, 0}, {0, 0, 1}, points, Options(4, false));
  if (fit) {
    EXPECT_LT(fit->axial_spread_mm, 0.05);
  }
}

TEST(CylinderFit, KeepsTheSignOfTheGuess) {
  Random random(6);
  const Points points = tests::CylinderPoints(4, 8, 1000, random);
  const auto fit = FitCylinder({0, 0, 0}, {0, 0, -1}, points, Options(4, false));
  ASSERT_TRUE(fit);
  EXPECT_LT(fit->axis.z(), -0.999999);
}

TEST(CylinderFit, RefusesWhatIsNoCylinder) {
  Random random(7);
  const CylinderFitOptions options = Options(4, true);
  EXPECT_FALSE(FitCylinder({0, 0, 0}, {0, 0, 1}, {}, options));
  EXPECT_FALSE(FitCylinder({0, 0, 0}, {0, 0, 1}, tests::CylinderPoints(4, 4, 9, random), options));
  // Nothing within reach of the guess.
  EXPECT_FALSE(
      FitCylinder({50, 0, 0}, {0, 0, 1}, tests::CylinderPoints(4, 8, 1000, random), options));
  // One line along the axis: the axis may go round it.
  Points line;
  for (int i = -100; i <= 100; ++i) line.emplace_back(4, 0, 0.04 * i);
  EXPECT_FALSE(FitCylinder({0, 0, 0}, {0, 0, 1}, line, options));
  EXPECT_FALSE(FitCylinder({0, 0, 0}, {0, 0, 1}, line, Options(4, false)));
  // All at one place, and on the axis itself.
  EXPECT_FALSE(FitCylinder({0, 0, 0}, {0, 0, 1}, Points(100, {4, 0, 0}), options));
  EXPECT_FALSE(FitCylinder({0, 0, 0}, {0, 0, 1}, Points(100, {0, 0, 0}), options));
}

}  // namespace
}  // namespace bendloop::pipeline
