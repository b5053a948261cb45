// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/rational_bezier.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace bendloop::pipeline {
namespace {

using Eigen::Vector3d;

// Half an ellipse with half axes a along x and b along y, exact: an inner weight of 1/3.
RationalCubic HalfEllipse(double a, double b, double side) {
  return {{Vector3d(side * a, 0, 0), Vector3d(side * a, 2 * side * b, 0),
           Vector3d(-side * a, 2 * side * b, 0), Vector3d(-side * a, 0, 0)},
          {1, 1.0 / 3, 1.0 / 3, 1}};
}

RationalCubic Twisted() {
  return {{Vector3d(0, 0, 0), Vector3d(1, 2, 0), Vector3d(3, 2, 1), Vector3d(4, 0, 2)},
          {0.7, 1.9, 0.6, 1.3}};
}

TEST(RationalBezier, HoldsAConicExactly) {
  const RationalCubic half = HalfEllipse(5, 3, 1);
  for (double u = 0; u <= 1; u += 0.05) {
    const Vector3d at = half.At(u);
    EXPECT_NEAR(at.x() * at.x() / 25 + at.y() * at.y() / 9, 1, 1e-14);
  }
  const RationalCubic circle = HalfEllipse(2, 2, 1);
  EXPECT_NEAR(circle.LengthMm(), 2 * std::numbers::pi, 1e-9);
}

TEST(RationalBezier, DerivativesAreThoseOfItsPlaces) {
  const RationalCubic piece = Twisted();
  const double h = 1e-5;
  for (const double u : {0.1, 0.4, 0.8}) {
    const Vector3d slope = (piece.At(u + h) - piece.At(u - h)) / (2 * h);
    const Vector3d bend = (piece.DerivativeAt(u + h) - piece.DerivativeAt(u - h)) / (2 * h);
    EXPECT_LT((slope - piece.DerivativeAt(u)).norm(), 1e-7);
    EXPECT_LT((bend - piece.SecondDerivativeAt(u)).norm(), 1e-6);
  }
}

TEST(RationalBezier, StandardFormAndPartsAreTheSameCurve) {
  const RationalCubic piece = Twisted();
  const RationalCubic standard = piece.InStandardForm();
  EXPECT_NEAR(standard.weight[0], 1, 1e-14);
  EXPECT_NEAR(standard.weight[3], 1, 1e-14);
  RationalBezier whole;
  whole.pieces = {piece};
  const auto parts = piece.SplitAt(0.3);
  for (const double u : {0.0, 0.2, 0.5, 0.9, 1.0}) {
    EXPECT_LT(whole.NearestTo(standard.At(u)).distance_mm, 1e-9);
    EXPECT_LT(whole.NearestTo(parts[0].At(u)).distance_mm, 1e-9);
    EXPECT_LT(whole.NearestTo(parts[1].At(u)).distance_mm, 1e-9);
  }
  EXPECT_NEAR(parts[0].LengthMm() + parts[1].LengthMm(), piece.LengthMm(), 1e-6);
}

TEST(RationalBezier, FindsTheNearestPoint) {
  RationalBezier ellipse;
  ellipse.pieces = {HalfEllipse(5, 3, 1), HalfEllipse(5, 3, -1)};
  ellipse.closed = true;
  ellipse.corner = {false, false};
  EXPECT_LT(ellipse.JointAngle(0), 1e-15);
  EXPECT_LT(ellipse.JointAngle(1), 1e-15);
  const CurveFoot foot = ellipse.NearestTo({0, -4, 1});
  EXPECT_EQ(foot.piece, 1U);
  EXPECT_NEAR(foot.distance_mm, std::sqrt(2.0), 1e-12);
  EXPECT_LT((ellipse.At(foot) - Vector3d(0, -3, 0)).norm(), 1e-8);
}

}  // namespace
}  // namespace bendloop::pipeline
