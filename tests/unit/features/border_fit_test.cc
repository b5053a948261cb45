// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/border_fit.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>

#include "pipeline/features/border_corners.h"
#include "pipeline/features/border_fit_ceres.h"
#include "tests/support/border_shapes.h"

namespace bendloop::pipeline {
namespace {

using namespace bendloop::tests;
using Eigen::Vector3d;

double MostJointAngle(const BorderFit& fit) {
  double most = 0;
  for (std::size_t p = 0; p < fit.curve.pieces.size(); ++p) {
    if (!fit.curve.corner[p]) most = std::max(most, fit.curve.JointAngle(p));
  }
  return most;
}

void ExpectJoined(const BorderFit& fit) {
  const auto& pieces = fit.curve.pieces;
  for (std::size_t p = 0; p < pieces.size(); ++p) {
    if (p + 1 == pieces.size() && !fit.curve.closed) break;
    EXPECT_EQ((pieces[p].control_mm[3] - pieces[(p + 1) % pieces.size()].control_mm[0]).norm(), 0);
  }
  EXPECT_LT(MostJointAngle(fit), 1e-9);
}

const BorderShape kHole = DrilledHole(12, 4, 3, 0.3);

TEST(PaperFit, JoinsItsPiecesAndReachesThePapersQuality) {
  const OrderedBorder border = SampleBorder(kHole, 160, 0.01, 1);
  const BorderFit fit = FitBorderAsPaper(border, EvenBreaks(border, 4), {});
  ASSERT_EQ(fit.curve.pieces.size(), 4U);
  ExpectJoined(fit);
  EXPECT_LE(fit.iterations, 10);
  EXPECT_LT(fit.Relative(), 2e-4);  // the paper's first segment of example 1
}

TEST(PaperFit, IsBetterWithParametersOfTheNearestPoints) {
  const OrderedBorder border = SampleBorder(ObliqueCut(12, 0.7), 160, 0, 1);
  PaperFitOptions refined;
  refined.refinements = 5;
  const auto breaks = EvenBreaks(border, 4);
  EXPECT_LT(FitBorderAsPaper(border, breaks, refined).SumMm2(),
            0.3 * FitBorderAsPaper(border, breaks, {}).SumMm2());
}

TEST(CurveFit, ReproducesAConicExactly) {
  for (const double tilt : {0.0, 0.3, 1.0}) {
    const BorderShape ellipse = ObliqueCut(12, tilt);
    const auto fit = FitBorder(SampleBorder(ellipse, 120, 0, 1));
    ASSERT_TRUE(fit);
    ExpectJoined(*fit);
    EXPECT_LT(CurveErrorMm(fit->curve, ellipse), 1e-6) << tilt;
  }
}

TEST(CurveFit, LeavesWhatTheNoiseLeaves) {
  for (const double noise_mm : {0.01, 0.05, 0.1}) {
    for (const BorderShape& shape : {ObliqueCut(12, 0.3), kHole, RoundSlot(12, 20, 6)}) {
      const auto fit = FitBorder(SampleBorder(shape, 300, noise_mm, 5, 0.01));
      ASSERT_TRUE(fit);
      ExpectJoined(*fit);
      EXPECT_NEAR(fit->noise_sigma_mm, noise_mm, 0.1 * noise_mm);
      // Two directions, and what the pieces cannot follow below the noise.
      EXPECT_LT(CurveErrorMm(fit->curve, shape), 0.6 * noise_mm);
      EXPECT_LT(fit->curve_sigma_mm, 0.4 * noise_mm);
      EXPECT_LE(fit->curve.pieces.size(), 8U);
    }
  }
}

TEST(CurveFit, IsNowhereWorseThanThePapers) {
  for (const double noise_mm : {0.0, 0.02, 0.1}) {
    const OrderedBorder border = SampleBorder(kHole, 160, noise_mm, 2);
    const BorderFit paper =
        FitBorderAsPaper(border, EvenBreaks(border, 4), {.points_of_piece = 99});
    const auto free = FitBorderFrom(border, paper.curve);
    ASSERT_TRUE(free);
    EXPECT_LT(free->SumMm2(), paper.SumMm2());
  }
}

TEST(CurveFit, KeepsCorners) {
  const BorderShape slot = SquareSlot(12, 20, 6);
  for (const double noise_mm : {0.0, 0.01, 0.05}) {
    const OrderedBorder border = SampleBorder(slot, 400, noise_mm, 3, 0.013);
    EXPECT_EQ(FindCorners(border, BorderNoiseMm(border)).size(), 4U) << noise_mm;
    const auto fit = FitBorder(border);
    ASSERT_TRUE(fit);
    ExpectJoined(*fit);
    EXPECT_EQ(std::count(fit->curve.corner.begin(), fit->curve.corner.end(), true), 4);
    EXPECT_LT(CurveErrorMm(fit->curve, slot), 0.5 * noise_mm + 1e-3);
    if (noise_mm > 0.01) continue;  // the last few points of a side hardly tell its direction
    for (std::size_t p = 0; p < fit->curve.pieces.size(); ++p) {
      if (!fit->curve.corner[p]) continue;
      EXPECT_NEAR(fit->curve.JointAngle(p), 1.5708, 0.01 + 10 * noise_mm);
    }
  }
}

TEST(CurveFit, FindsNoCornersInBends) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    for (const BorderShape& shape : {RoundSlot(12, 20, 6), ObliqueCut(12, 1.0), kHole}) {
      const OrderedBorder border = SampleBorder(shape, 300, 0.05, seed);
      EXPECT_TRUE(FindCorners(border, BorderNoiseMm(border)).empty()) << seed;
    }
  }
}

TEST(CurveFit, MovesWithThePoints) {
  const OrderedBorder border = SampleBorder(kHole, 200, 0.03, 4);
  const Eigen::Isometry3d motion =
      Eigen::Translation3d(300, -20, 70) * Eigen::AngleAxisd(1.1, Vector3d(1, 2, -1).normalized());
  OrderedBorder moved = border;
  for (Vector3d& point : moved.points_mm) point = motion * point;
  const auto here = FitBorder(border), there = FitBorder(moved);
  ASSERT_TRUE(here && there);
  ASSERT_EQ(here->curve.pieces.size(), there->curve.pieces.size());
  EXPECT_LT(CurveErrorMm(there->curve,
                         [&](double t) {
                           return motion *
                                  here->curve.Sampled(400)[static_cast<std::size_t>(t * 400)];
                         }),
            1e-4);
  EXPECT_NEAR(here->noise_sigma_mm, there->noise_sigma_mm, 1e-5);
}

TEST(CurveFit, FollowsOpenBorders) {
  OrderedBorder border;
  for (int i = 0; i <= 100; ++i) border.points_mm.emplace_back(0.1 * i, std::sin(0.06 * i), 0);
  const auto fit = FitBorder(border);
  ASSERT_TRUE(fit);
  EXPECT_FALSE(fit->curve.closed);
  ExpectJoined(*fit);
  EXPECT_LT(std::sqrt(fit->SumMm2() / 101), 1e-3);
  EXPECT_LT((fit->curve.pieces.front().control_mm[0] - border.points_mm.front()).norm(), 1e-2);
}

TEST(CurveFit, RefusesWhatIsNoBorder) {
  OrderedBorder border;
  EXPECT_FALSE(FitBorder(border));
  border.points_mm.assign(5, Vector3d(1, 2, 3));
  EXPECT_FALSE(FitBorder(border));
  border.points_mm.assign(50, Vector3d(1, 2, 3));
  EXPECT_FALSE(FitBorder(border));
  border.points_mm[7].x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(FitBorder(border));
  OrderedBorder line;
  for (int i = 0; i < 50; ++i) line.points_mm.emplace_back(i, 0, 0);
  const auto fit = FitBorder(line);
  ASSERT_TRUE(fit);
  EXPECT_LT(fit->SumMm2(), 1e-6);
  line.closed = true;  // there and back in one leap
  EXPECT_TRUE(FitBorder(line));
}

}  // namespace
}  // namespace bendloop::pipeline
