// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/die_spread.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

#include "pipeline/fit/one_die.h"
#include "pipeline/fit/tube_parameters.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

constexpr double kRadiusMm = 15, kEasingMm2 = 12;

// Bends whose radii are so far beside the mean, and known to so much of what is usual.
SurfaceFit FitWith(const std::array<double, 3>& beside_mm, double known) {
  SurfaceFit fit;
  fit.tube = ThreeBends();
  for (std::size_t i = 0; i < beside_mm.size(); ++i) {
    fit.tube.program.rows[i].bend_radius_mm = kRadiusMm + beside_mm[i];
  }
  fit.easing = Easing{{kEasingMm2, kEasingMm2, kEasingMm2}};
  fit.priors.radii_alike = kRadiiOfOneDie;
  const TubeParameters parameters(fit.tube, true, fit.flattening, fit.easing);
  fit.covariance = 1e-6 * Eigen::MatrixXd::Identity(parameters.size(), parameters.size());
  for (std::size_t i = 0; i < parameters.bends(); ++i) {
    const int radius = parameters.bend_radius(i), easing = parameters.easing(i);
    const double usual_mm = fit.priors.radii_alike * kRadiusMm;
    fit.covariance(radius, radius) = std::pow(known * usual_mm, 2);
    // As known as before.
    fit.covariance(easing, easing) = std::pow(fit.priors.easings_alike * kEasingMm2, 2);
  }
  return fit;
}

TEST(DieSpread, IsLearntFromBendsThatThePointsKnow) {
  const double usual_mm = kRadiiOfOneDie * kRadiusMm;
  const FitPriors alike = LearnDieSpread(FitWith({0, 0, 0}, 0.05), true);
  EXPECT_LT(alike.radii_alike, 0.4 * kRadiiOfOneDie);
  // As much of that as the points know.
  const FitPriors known = LearnDieSpread(FitWith({0, 0, 0}, 0.01), true);
  EXPECT_LT(known.radii_alike, 0.1 * kRadiiOfOneDie);
  const FitPriors differ =
      LearnDieSpread(FitWith({2.5 * usual_mm, -2 * usual_mm, -0.5 * usual_mm}, 0.05), true);
  EXPECT_GT(differ.radii_alike, 1.3 * kRadiiOfOneDie);
}

TEST(DieSpread, StaysAsUsualWherePointsTellNothing) {
  const FitPriors priors = LearnDieSpread(FitWith({0, 0, 0}, 1.0), true);
  EXPECT_NEAR(priors.radii_alike, kRadiiOfOneDie, 0.1 * kRadiiOfOneDie);
  EXPECT_NEAR(priors.easings_alike, FitPriors{}.easings_alike, 0.1 * FitPriors{}.easings_alike);
}

// Dents and places that disagree make a fit less certain than its priors: that says nothing of
// them.
TEST(DieSpread, StaysAsUsualWhereAFitIsVaguerThanItsPriors) {
  for (const double known : {1.09, 1.1, 2.0, 20.0}) {
    const FitPriors priors = LearnDieSpread(FitWith({0, 0, 0}, known), true);
    EXPECT_NEAR(priors.radii_alike, kRadiiOfOneDie, 0.1 * kRadiiOfOneDie);
  }
}

TEST(DieSpread, OfSharpBendsOfAnyDiesIsNothing) {
  SurfaceFit fit = FitWith({0, 0, 0}, 1.0);
  fit.priors.radii_alike = 0;
  fit.easing = {};
  fit.covariance.conservativeResize(TubeParameters(fit.tube, true).size(),
                                    TubeParameters(fit.tube, true).size());
  EXPECT_EQ(LearnDieSpread(fit, true).radii_alike, 0);
}

// One of them has a dent there, as seems.
TEST(DieSpread, WallsSinkInAsThoseOfTheOthersDo) {
  SurfaceFit fit = FitWith({0, 0, 0}, 1.0);
  fit.flattening = {{.bump = 0.04}, {.bump = 0.04, .collapse = 0.05}, {.bump = 0.04}};
  EXPECT_LT(LearnSunk(fit), 0.01);
  for (Flattening& of : fit.flattening) of.collapse = 0.05;
  EXPECT_EQ(LearnSunk(fit), kUsualFlattening);
  fit.flattening.resize(1);
  EXPECT_EQ(LearnSunk(fit), kUsualFlattening);
}

TEST(DieSpread, OfFitsWithoutACovarianceStaysAsUsual) {
  SurfaceFit fit = FitWith({0, 0, 0}, 1.0);
  fit.covariance(0, 0) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(LearnDieSpread(fit, true).radii_alike, kRadiiOfOneDie);
}

}  // namespace
}  // namespace bendloop::pipeline
