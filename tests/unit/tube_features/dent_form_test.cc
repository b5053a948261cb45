// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/dent_form.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/support/cut_walls.h"

namespace bendloop::pipeline {
namespace {

using tests::Uniform;

DentForm::Numbers AnyForm(std::mt19937_64& random) {
  return {.log_power = Uniform(random, -1, 2),
          .tail = Uniform(random, -1, 1.5),
          .log_bottom = Uniform(random, -2, 2)};
}

TEST(DentForm, IsAGaussianUnlessToldOtherwise) {
  const DentForm gaussian({.log_power = 0, .tail = 0, .log_bottom = -3});
  for (const double q : {0.01, 0.3, 1.0, 2.0, 4.0}) {
    EXPECT_NEAR(gaussian.At(q).f, std::exp2(-q), 1e-3) << q;
  }
  EXPECT_NEAR(gaussian.HalfQ(), 1.0, 1e-3);
}

TEST(DentForm, IsWholeInItsMiddleAndHalfWhereItSays) {
  std::mt19937_64 random(5);
  for (int i = 0; i < 200; ++i) {
    const DentForm form(AnyForm(random));
    EXPECT_NEAR(form.At(1e-30).f, 1.0, 1e-3);
    EXPECT_NEAR(form.At(form.HalfQ()).f, 0.5, 1e-9);
  }
}

TEST(DentForm, ABottomIsFlatAndEndsAtOnce) {
  const DentForm cone({.log_power = std::log(0.5), .tail = -1, .log_bottom = std::log(2.0)});
  EXPECT_NEAR(cone.At(0.5).f, 1.0, 0.02);
  // A cone that would go on to twice its depth is at a quarter of that, and falls on.
  EXPECT_NEAR(cone.At(2.25).f, 0.5, 0.01);
  EXPECT_NEAR(cone.At(4.0).f, 0.0, 1e-9);
}

TEST(DentForm, DerivativesAreThose) {
  std::mt19937_64 random(7);
  for (int i = 0; i < 200; ++i) {
    const DentForm::Numbers x = AnyForm(random);
    const double log_q = Uniform(random, -3, 0.3);
    const auto slope = [&](double DentForm::Numbers::*of, double by_q) {
      constexpr double kStep = 1e-5;
      DentForm::Numbers more = x, less = x;
      if (of != nullptr) more.*of += kStep, less.*of -= kStep;
      return (DentForm(more).At(std::exp(log_q + by_q * kStep)).f -
              DentForm(less).At(std::exp(log_q - by_q * kStep)).f) /
             (2 * kStep);
    };
    const DentForm::Row row = DentForm(x).At(std::exp(log_q));
    constexpr double kClose = 1e-5;
    EXPECT_NEAR(row.by_log_q, slope(nullptr, 1), kClose);
    EXPECT_NEAR(row.by_power, slope(&DentForm::Numbers::log_power, 0), kClose);
    EXPECT_NEAR(row.by_tail, slope(&DentForm::Numbers::tail, 0), kClose);
    EXPECT_NEAR(row.by_bottom, slope(&DentForm::Numbers::log_bottom, 0), kClose);
  }
}

}  // namespace
}  // namespace bendloop::pipeline
