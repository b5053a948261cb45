// SPDX-License-Identifier: Apache-2.0
// Planes of tube ends: their error against the bound of the sampled border, and whether 1 sigma is
// what it says.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "hal/angles.h"
#include "pipeline/features/end_plane_fit.h"

namespace bendloop::pipeline {
namespace {

constexpr double kRadiusMm = 8, kWindowMm = 3 * kRadiusMm;

struct Border {
  double at_mm = 0, slope = 0, around_rad = 0;
  double At(double around) const {
    return at_mm + kRadiusMm * slope * std::cos(around - around_rad);
  }
};

class Tubes {
 public:
  explicit Tubes(unsigned seed) : random_(seed) {}
  double Uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  double Normal(double sigma) { return std::normal_distribution<double>(0, sigma)(random_); }

  Border ABorder(double obliquity_deg) {
    return {Uniform(-1, 1), std::tan(obliquity_deg * hal::kRadiansPerDegree),
            Uniform(-std::numbers::pi, std::numbers::pi)};
  }
  // Evenly all over; noise moves them along the tube by `smear_mm`.
  std::vector<EndSample> Scattered(const Border& border, double per_mm2, double smear_mm) {
    const double from_mm = -kWindowMm - 10, to_mm = 4;
    const double area = 2 * std::numbers::pi * kRadiusMm * (to_mm - from_mm);
    std::vector<EndSample> samples;
    for (int i = 0; i < static_cast<int>(per_mm2 * area); ++i) {
      const double around = Uniform(-std::numbers::pi, std::numbers::pi);
      const double at_mm = Uniform(from_mm, to_mm);
      if (at_mm < border.At(around)) samples.push_back({around, at_mm + Normal(smear_mm)});
    }
    return samples;
  }
  // Passes of a laser line from several sides; `known`: which pass a sample came in.
  std::vector<EndSample> Lines(const Border& border, double spacing_mm, int passes, double smear_mm,
                               bool known = false) {
    std::vector<EndSample> samples;
    for (int pass = 0; pass < passes; ++pass) {
      const double first_mm = -kWindowMm - 10 + Uniform(0, spacing_mm);
      const double tilt = Normal(0.005), tilt_to = Uniform(-3, 3);
      for (double at_mm = first_mm; at_mm < 4; at_mm += spacing_mm) {
        for (double across = -0.95; across < 0.95; across += 0.03) {
          const double around = std::remainder(
              std::asin(across) + 2 * std::numbers::pi * pass / passes, 2 * std::numbers::pi);
          const double line_mm = at_mm + kRadiusMm * tilt * std::cos(around - tilt_to);
          if (line_mm < border.At(around))
            samples.push_back({around, line_mm + Normal(smear_mm), known ? unsigned(pass) : 0U});
        }
      }
    }
    return samples;
  }

  // Known passes of a hand that holds the scanner unsteadily: lines lie a tenth of their distance
  // beside where they should, and their tilt goes on with the hand's.
  std::vector<EndSample> UnsteadyLines(const Border& border, double spacing_mm, int passes,
                                       double tilt, double smear_mm) {
    std::vector<EndSample> samples;
    for (int pass = 0; pass < passes; ++pass) {
      const double view = 2 * std::numbers::pi * (pass + Uniform(-0.2, 0.2)) / passes;
      const double kept = std::exp(-spacing_mm / 15.0), more = std::sqrt(1 - kept * kept);
      double towards = Normal(tilt), sideways = Normal(tilt);
      double at_mm = -kWindowMm - 10 + Uniform(0, spacing_mm);
      for (; at_mm < 8; at_mm += spacing_mm) {
        towards = kept * towards + more * Normal(tilt);
        sideways = kept * sideways + more * Normal(tilt);
        const double off_mm = at_mm + Normal(0.1 * spacing_mm);
        for (double across = -0.95; across < 0.95; across += 0.03) {
          const double from_view = std::asin(across);
          const double around = std::remainder(view + from_view, 2 * std::numbers::pi);
          const double line_mm =
              off_mm + kRadiusMm * (towards * std::cos(from_view) + sideways * across);
          if (line_mm < border.At(around))
            samples.push_back({around, line_mm + Normal(smear_mm), unsigned(pass)});
        }
      }
    }
    return samples;
  }

 private:
  std::mt19937_64 random_;
};

// Mean squares of the errors, and of the errors in sigmas.
struct Errors {
  double at = 0, slope = 0, at_sigmas = 0, slope_sigmas = 0, count = 0;
  void Add(const Border& truth, const EndPlane& plane) {
    const double off = plane.at_mm - truth.at_mm;
    const double slope2 =
        0.5 * (std::pow(plane.cosine - truth.slope * std::cos(truth.around_rad), 2) +
               std::pow(plane.sine - truth.slope * std::sin(truth.around_rad), 2));
    at += off * off;
    slope += slope2;
    at_sigmas += std::pow(off / plane.at_sigma_mm, 2);
    slope_sigmas += slope2 / std::pow(plane.slope_sigma, 2);
    count += 1;
  }
  double At() const { return std::sqrt(at / count); }
  double Slope() const { return std::sqrt(slope / count); }
};

// Samples with density n behind a border that noise smears by s are a Poisson process whose
// intensity falls like the normal distribution's; moving the border tells as much as
// n / s * integral of phi^2 / Phi = 0.903 n / s of each mm of it. So the Cramer-Rao bound of a
// plane's place is sqrt(s / (0.903 n 2 pi r)), and of either slope sqrt(2) / r of that.
TEST(EndPlane, IsAsSureAsTheSampledBorderLets) {
  constexpr double kDensity = 6, kSmearMm = 0.05;
  constexpr int kTubes = 60;
  Tubes tubes(1);
  Errors errors;
  for (int i = 0; i < kTubes; ++i) {
    const Border border = tubes.ABorder(i % 2 == 0 ? 2.0 : 0.0);
    const auto plane = FitEndPlane(tubes.Scattered(border, kDensity, kSmearMm), kRadiusMm,
                                   kWindowMm, 2 * kSmearMm);
    ASSERT_TRUE(plane);
    errors.Add(border, *plane);
  }
  const double information = 0.903 * kDensity / kSmearMm * 2 * std::numbers::pi * kRadiusMm;
  const double bound_mm = 1 / std::sqrt(information);
  EXPECT_LT(errors.At(), 1.3 * bound_mm);
  EXPECT_LT(errors.Slope(), 1.3 * std::sqrt(2.0) * bound_mm / kRadiusMm);
  EXPECT_LT(std::sqrt(errors.at_sigmas / errors.count), 1.3);
  EXPECT_LT(std::sqrt(errors.slope_sigmas / errors.count), 1.3);
}

// However dense they are: of an end only some are looked at, but of its border all. `thought`: how
// far noise is thought to displace them, of how far it does.
void ExpectAllSamplesCount(unsigned seed, double thought, double most_over_bound) {
  constexpr double kDensity = 60, kSmearMm = 0.02;
  constexpr int kTubes = 24;
  Tubes tubes(seed);
  Errors errors;
  for (int i = 0; i < kTubes; ++i) {
    const Border border = tubes.ABorder(i % 2 == 0 ? 3.0 : 0.0);
    const auto plane = FitEndPlane(tubes.Scattered(border, kDensity, kSmearMm), kRadiusMm,
                                   kWindowMm, 2 * thought * kSmearMm);
    ASSERT_TRUE(plane);
    errors.Add(border, *plane);
  }
  const double information = 0.903 * kDensity / kSmearMm * 2 * std::numbers::pi * kRadiusMm;
  const double bound_mm = 1 / std::sqrt(information);
  EXPECT_LT(errors.At(), most_over_bound * bound_mm);
  EXPECT_LT(errors.Slope(), 1.3 * std::sqrt(2.0) * bound_mm / kRadiusMm);
  EXPECT_LT(std::sqrt(errors.at_sigmas / errors.count), 1.4);
  EXPECT_LT(std::sqrt(errors.slope_sigmas / errors.count), 1.3);
}
TEST(EndPlane, OfDenseSamplesIsToldByAllBesideTheBorder) { ExpectAllSamplesCount(11, 1.0, 1.3); }
// Not knowing the noise costs a place a quarter of its bound, and slopes nothing.
TEST(EndPlane, OfDenseSamplesTellsOtherNoiseByItself) {
  ExpectAllSamplesCount(12, 2.0, 1.7);
  ExpectAllSamplesCount(13, 0.5, 1.7);
}

// Of laser lines along the border one may have passed just beyond it: half a gap is unknown.
TEST(EndPlane, OfLaserLinesIsBetweenTheLastAndTheNext) {
  for (const int passes : {1, 3}) {
    Tubes tubes(2);
    Errors errors;
    for (int i = 0; i < 30; ++i) {
      const Border border = tubes.ABorder(i % 2 == 0 ? 3.0 : 0.0);
      const auto plane =
          FitEndPlane(tubes.Lines(border, 1.0, passes, 0.015), kRadiusMm, kWindowMm, 0.03);
      ASSERT_TRUE(plane);
      errors.Add(border, *plane);
    }
    EXPECT_LT(errors.At(), 1.3 / std::sqrt(12.0)) << passes;
    EXPECT_LT(std::sqrt(errors.at_sigmas / errors.count), 1.5) << passes;
    EXPECT_LT(std::sqrt(errors.slope_sigmas / errors.count), 1.5) << passes;
  }
}

// Whatever the cut, the lines' spacing and the sides it was seen from: the error is as great as the
// sigma says. A belief in square ends once pulled cuts of 4 degrees to 2.
TEST(EndPlane, OfKnownPassesIsAsFarOffAsItSays) {
  Tubes tubes(5);
  Errors errors;
  for (int i = 0; i < 60; ++i) {
    const Border border = tubes.ABorder(tubes.Uniform(0, 20));
    const double spacing_mm = tubes.Uniform(0.2, 1.0), smear_mm = tubes.Uniform(0.002, 0.02);
    const auto plane = FitEndPlane(tubes.Lines(border, spacing_mm, 1 + i % 6, smear_mm, true),
                                   kRadiusMm, kWindowMm, 2 * smear_mm);
    ASSERT_TRUE(plane);
    EXPECT_TRUE(plane->of_lines);
    EXPECT_NEAR(plane->at_mm, border.at_mm, 4.5 * plane->at_sigma_mm) << i;
    errors.Add(border, *plane);
  }
  for (const double sigmas : {errors.at_sigmas, errors.slope_sigmas}) {
    EXPECT_GT(std::sqrt(sigmas / errors.count), 0.6);
    EXPECT_LT(std::sqrt(sigmas / errors.count), 1.3);
  }
}

// Lines that a hand tilts lie all along the tube, as scattered samples do: ends were told right
// behind their outermost sample.
TEST(EndPlane, OfAnUnsteadyHandIsAsFarOffAsItSays) {
  Tubes tubes(7);
  Errors errors;
  for (int i = 0; i < 120; ++i) {
    const Border border = tubes.ABorder(i % 2 == 0 ? 0.0 : tubes.Uniform(0.5, 12));
    const double spacing_mm = tubes.Uniform(0.4, 1.5), tilt = tubes.Uniform(0.01, 0.035);
    const auto plane = FitEndPlane(tubes.UnsteadyLines(border, spacing_mm, 3 + i % 5, tilt, 0.01),
                                   kRadiusMm, kWindowMm, 0.02);
    ASSERT_TRUE(plane);
    EXPECT_TRUE(plane->of_lines) << i;
    EXPECT_NEAR(plane->at_mm, border.at_mm, 4.5 * plane->at_sigma_mm) << i;
    errors.Add(border, *plane);
  }
  for (const double sigmas : {errors.at_sigmas, errors.slope_sigmas}) {
    EXPECT_GT(std::sqrt(sigmas / errors.count), 0.6);
    EXPECT_LT(std::sqrt(sigmas / errors.count), 1.3);
  }
}

// Lines that an oblique cut ends halfway tell its slope far better than their spacing.
TEST(EndPlane, OfKnownPassesIsToldToTheDistanceOfRays) {
  Tubes tubes(6);
  for (int i = 0; i < 10; ++i) {
    const Border border = tubes.ABorder(6);
    const auto plane =
        FitEndPlane(tubes.Lines(border, 0.5, 4, 0.005, true), kRadiusMm, kWindowMm, 0.01);
    ASSERT_TRUE(plane);
    EXPECT_LT(plane->slope_sigma, 0.2 * hal::kRadiansPerDegree);
    EXPECT_GT(plane->slope_sigmas, 5);
  }
}

TEST(EndPlane, IsNotToldByAFewSamples) {
  Tubes tubes(3);
  const auto samples = tubes.Scattered({}, 0.02, 0.01);
  EXPECT_FALSE(FitEndPlane(samples, kRadiusMm, kWindowMm, 0.02));
}

// Of a few hundred samples a square end was said to be oblique for certain, now and then: the
// samples that were missing beyond the plane were as few as chance leaves out that often.
TEST(EndPlane, OfFewSamplesIsObliqueOnlyWhereEnoughAreMissing) {
  Tubes tubes(11);
  int oblique = 0;
  for (int i = 0; i < 1000; ++i) {
    const Border border = tubes.ABorder(0);
    const auto plane =
        FitEndPlane(tubes.Scattered(border, 0.5 + 0.0005 * i, 0.025), kRadiusMm, kWindowMm, 0.05);
    oblique += plane && plane->slope_sigmas > 5 ? 1 : 0;
  }
  EXPECT_EQ(oblique, 0);
}

// A table touches one side and goes on beyond the end.
TEST(EndPlane, LeavesOutWhatGoesOnBesideIt) {
  Tubes tubes(4);
  const Border border = tubes.ABorder(0);
  auto samples = tubes.Scattered(border, 6, 0.02);
  for (double at_mm = -30; at_mm < 6; at_mm += 0.2) {
    for (double around = 1.0; around < 1.3; around += 0.03) samples.push_back({around, at_mm});
  }
  const auto plane = FitEndPlane(samples, kRadiusMm, kWindowMm, 0.04);
  ASSERT_TRUE(plane);
  EXPECT_NEAR(plane->at_mm, border.at_mm, 0.1);
  EXPECT_LT(std::hypot(plane->cosine, plane->sine), std::tan(1.0 * hal::kRadiansPerDegree));
}

}  // namespace
}  // namespace bendloop::pipeline
