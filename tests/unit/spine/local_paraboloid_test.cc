// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/local_paraboloid.h"

#include <gtest/gtest.h>

#include "tests/support/shapes.h"

namespace bendloop::pipeline {
namespace {

using tests::kPi;
using tests::Points;
using tests::Random;
using tests::Uniform;

// The two centres of curvature seen from the foot: independent of the normal's sign.
Eigen::Vector3d CenterOf(const LocalParaboloid& fit, std::size_t k) {
  return fit.foot_mm + fit.normal / fit.curvature[k];
}

void ExpectFrame(const LocalParaboloid& fit) {
  EXPECT_NEAR(fit.normal.norm(), 1, 1e-12);
  for (const auto& d : fit.direction) {
    EXPECT_NEAR(d.norm(), 1, 1e-12);
    EXPECT_NEAR(d.dot(fit.normal), 0, 1e-9);
  }
  EXPECT_NEAR(fit.direction[0].dot(fit.direction[1]), 0, 1e-9);
  EXPECT_GE(std::abs(fit.curvature[0]), std::abs(fit.curvature[1]));
}

TEST(LocalParaboloid, IsExactOnAParaboloidInAnyPose) {
  Random random(1);
  for (int run = 0; run < 20; ++run) {
    const double a = Uniform(random, 0.05, 0.2);
    const double b = Uniform(random, -0.04, 0.04);
    Points points;
    for (int i = -4; i <= 4; ++i) {
      for (int j = -4; j <= 4; ++j) {
        const double x = 0.2 * i, y = 0.2 * j;
        points.emplace_back(x, y, 0.5 * (a * x * x + b * y * y));
      }
    }
    const hal::Pose pose = tests::RandomPose(300, random);
    const auto fit =
        FitLocalParaboloid(pose * Eigen::Vector3d::Zero(), tests::Moved(points, pose), 1.1);
    ASSERT_TRUE(fit);
    ExpectFrame(*fit);
    const double up = fit->normal.dot(pose.orientation * Eigen::Vector3d::UnitZ()) > 0 ? 1 : -1;
    EXPECT_NEAR(up * fit->curvature[0], a, 1e-8);
    EXPECT_NEAR(up * fit->curvature[1], b, 1e-8);
    EXPECT_NEAR(std::abs(fit->direction[0].dot(pose.orientation * Eigen::Vector3d::UnitX())), 1,
                1e-8);
    EXPECT_NEAR((fit->foot_mm - pose.position_mm).norm(), 0, 1e-8);
    EXPECT_NEAR(fit->rms_mm, 0, 1e-6);
  }
}

// A small neighbourhood: what the terms of fourth order leave is below a hundredth.
TEST(LocalParaboloid, FindsTheCylinder) {
  Random random(2);
  for (const double r : {0.5, 4.0, 50.0}) {
    const Points points = tests::CylinderPoints(r, 0.3 * r, 8000, random, 0, -0.3, 0.3);
    const hal::Pose pose = tests::RandomPose(300, random);
    const auto fit =
        FitLocalParaboloid(pose * Eigen::Vector3d(r, 0, 0), tests::Moved(points, pose), 0.2 * r);
    ASSERT_TRUE(fit);
    ExpectFrame(*fit);
    EXPECT_NEAR(std::abs(fit->curvature[0]) * r, 1, 0.015);
    EXPECT_NEAR(fit->curvature[1] * r, 0, 0.015);
    EXPECT_NEAR((CenterOf(*fit, 0) - pose.position_mm).norm() / r, 0, 0.02);
    EXPECT_GT(std::abs(fit->direction[1].dot(pose.orientation * Eigen::Vector3d::UnitZ())), 0.9995);
    EXPECT_GT(std::abs(fit->normal.dot(pose.orientation * Eigen::Vector3d::UnitX())), 0.9999);
  }
}

// At the neighbourhood that the projection uses the bias must stay well inside what it accepts.
TEST(LocalParaboloid, StaysCloseOnTheNeighbourhoodOfTheProjection) {
  Random random(3);
  const Points points = tests::CylinderPoints(1, 1, 20000, random);
  const auto fit = FitLocalParaboloid({1, 0, 0}, points, 2.0 / 3.0);
  ASSERT_TRUE(fit);
  EXPECT_NEAR(std::abs(fit->curvature[0]), 1, 0.12);
  EXPECT_NEAR(fit->curvature[1], 0, 0.03);
}

TEST(LocalParaboloid, FindsTheSphere) {
  Random random(4);
  const auto fit = FitLocalParaboloid({0, 0, 7}, tests::SpherePoints(7, 200'000, random), 1.4);
  ASSERT_TRUE(fit);
  EXPECT_NEAR(std::abs(fit->curvature[0]) * 7, 1, 0.02);
  EXPECT_NEAR(std::abs(fit->curvature[1]) * 7, 1, 0.02);
  EXPECT_GT(fit->curvature[0] * fit->curvature[1], 0);
  EXPECT_NEAR(CenterOf(*fit, 0).norm(), 0, 0.2);
}

// A bend: outside both curvatures have one sign, inside they differ.
TEST(LocalParaboloid, FindsBothSidesOfABend) {
  Random random(5);
  const double r = 4, bend = 12;
  for (const bool outside : {true, false}) {
    const double middle = outside ? 0.0 : kPi;
    Points points;
    for (int i = 0; i < 8000; ++i) {
      const double phi = middle + Uniform(random, -0.3, 0.3);
      const double along = Uniform(random, -0.3, 0.3);
      const double rho = bend + r * std::cos(phi);
      points.emplace_back(rho * std::cos(along), rho * std::sin(along), r * std::sin(phi));
    }
    const double at = outside ? bend + r : bend - r;
    const auto fit = FitLocalParaboloid({at, 0, 0}, points, 0.8);
    ASSERT_TRUE(fit);
    ExpectFrame(*fit);
    EXPECT_NEAR(std::abs(fit->curvature[0]) * r, 1, 0.02);
    EXPECT_NEAR(std::abs(fit->curvature[1]) * at, 1, 0.03);
    EXPECT_EQ(fit->curvature[0] * fit->curvature[1] > 0, outside);
    EXPECT_NEAR((CenterOf(*fit, 0) - Eigen::Vector3d(bend, 0, 0)).norm(), 0, 0.1);
    EXPECT_GT(std::abs(fit->direction[1].y()), 0.999);
  }
}

TEST(LocalParaboloid, FootLiesBetweenNoisySamples) {
  Random random(6);
  const Points points = tests::CylinderPoints(4, 4, 6000, random, 0.05);
  double sum2 = 0;
  for (int i = 0; i < 100; ++i) {
    const auto fit = FitLocalParaboloid(points[static_cast<std::size_t>(i)], points, 2.7);
    if (!fit) continue;
    sum2 += std::pow(fit->foot_mm.head<2>().norm() - 4, 2);
    EXPECT_NEAR(fit->rms_mm, 0.05, 0.03);
  }
  EXPECT_LT(std::sqrt(sum2 / 100), 0.03);  // smoother than the samples themselves
}

TEST(LocalParaboloid, RefusesTooFewSamples) {
  Random random(7);
  Points points = tests::CylinderPoints(1, 0.4, 9, random, 0, -0.4, 0.4);
  EXPECT_FALSE(FitLocalParaboloid({1, 0, 0}, points, 2.0));
  EXPECT_FALSE(FitLocalParaboloid({1, 0, 0}, {}, 2.0));
  // Many, but only a few of them near.
  for (int i = 0; i < 1000; ++i) points.emplace_back(50 + i, 0, 0);
  EXPECT_FALSE(FitLocalParaboloid({1, 0, 0}, points, 2.0));
}

TEST(LocalParaboloid, RefusesOneAndTwoStripesAndTakesThree) {
  Random random(8);
  std::normal_distribution<double> noise(0, 0.003);
  Points points;
  for (int stripe = 0; stripe < 3; ++stripe) {
    const double z = stripe == 0 ? 0.0 : stripe == 1 ? 0.3 : -0.3;
    for (int i = 0; i < 200; ++i) {
      const double phi = Uniform(random, -0.5, 0.5);
      points.emplace_back(std::cos(phi) + noise(random), std::sin(phi), z);
    }
    EXPECT_EQ(FitLocalParaboloid({1, 0, 0}, points, 2.0 / 3.0).has_value(), stripe == 2) << stripe;
  }
}

TEST(LocalParaboloid, RefusesALineAndOnePlace) {
  Points line, place;
  for (int i = 0; i < 50; ++i) {
    line.emplace_back(0.01 * i, 0, 0);
    place.emplace_back(1, 2, 3);
  }
  EXPECT_FALSE(FitLocalParaboloid(line[25], line, 1.0));
  EXPECT_FALSE(FitLocalParaboloid(place[0], place, 1.0));
}

TEST(LocalParaboloid, SaysThatAPlaneIsFlat) {
  Random random(9);
  const auto fit = FitLocalParaboloid({0, 0, 0}, tests::PlanePoints(1, 500, random), 0.8);
  if (fit) {
    EXPECT_NEAR(fit->curvature[0], 0, 1e-9);
  }
}

}  // namespace
}  // namespace bendloop::pipeline
