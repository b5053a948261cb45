// SPDX-License-Identifier: Apache-2.0
// Ends in clouds of laser lines that nobody tells the passes of, and that lie aslant to the tube.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <random>
#include <vector>

#include "hal/angles.h"
#include "pipeline/features/end_plane_fit.h"
#include "tests/support/cut_walls.h"

namespace bendloop::pipeline::tilted_lines {
namespace {

using tests::LogUniform;
using tests::Uniform;
using Random = std::mt19937_64;

// A cut: how far it rises towards where the tube is longest, and a wave in it.
struct Cut {
  double r_mm = 8, at_mm = 0, slope = 0, to_rad = 0, wave_mm = 0;
  int waves = 3;  // in a turn
  double WaveMm(double around) const { return wave_mm * std::cos(waves * around); }
  double At(double around) const {
    return at_mm + r_mm * slope * std::cos(around - to_rad) + WaveMm(around);
  }
};

// Passes from several sides, each of even lines that are tilted by up to `tilt_rad`.
struct LineScan {
  double spacing_mm = 0.4, step_mm = 0.2, noise_mm = 0.03, tilt_rad = 0;
  int passes = 4;
};

std::vector<EndSample> ScanLines(const Cut& cut, const LineScan& scan, Random& random) {
  std::normal_distribution<double> noise(0, scan.noise_mm);
  const double r_mm = cut.r_mm, from_mm = -4 * r_mm;
  const double to_mm = cut.at_mm + r_mm * cut.slope + cut.wave_mm;
  std::vector<EndSample> samples;
  for (int pass = 0; pass < scan.passes; ++pass) {
    const double view = 2 * std::numbers::pi * (pass + Uniform(random, -0.1, 0.1)) / scan.passes;
    const double tilt = Uniform(random, -scan.tilt_rad, scan.tilt_rad);
    const double first_mm = Uniform(random, 0, scan.spacing_mm);
    const double aside_mm = Uniform(random, 0, scan.step_mm);
    for (double line = from_mm - r_mm + first_mm; line < to_mm + r_mm; line += scan.spacing_mm) {
      for (double across = -0.9 * r_mm + aside_mm; across < 0.9 * r_mm; across += scan.step_mm) {
        const double around = std::remainder(view + std::asin(across / r_mm), 2 * std::numbers::pi);
        const double at_mm = line - std::tan(tilt) * std::sqrt(r_mm * r_mm - across * across);
        if (at_mm < from_mm || at_mm > cut.At(around)) continue;
        samples.push_back({around, at_mm + noise(random) * std::sin(tilt)});
      }
    }
  }
  return samples;
}

struct Scanned {
  Cut cut;
  LineScan scan;
  std::vector<EndSample> samples;
};

Scanned AnyScan(unsigned seed, double slope_deg) {
  Random random(seed);
  Scanned any;
  any.cut.r_mm = LogUniform(random, 4, 15);
  any.cut.at_mm = Uniform(random, -1, 1);
  any.cut.slope = std::tan(slope_deg * hal::kRadiansPerDegree);
  any.cut.to_rad = Uniform(random, -3, 3);
  any.scan.spacing_mm = LogUniform(random, 0.1, 1.0);
  any.scan.step_mm = LogUniform(random, 0.1, 0.5);
  any.scan.noise_mm = LogUniform(random, 0.005, 0.1);
  any.scan.passes = 3 + static_cast<int>(seed % 4);
  const double tilt_deg = seed % 3 == 0 ? 0.0 : Uniform(random, 0, 30);
  any.scan.tilt_rad = tilt_deg * hal::kRadiansPerDegree;
  any.samples = ScanLines(any.cut, any.scan, random);
  return any;
}

std::optional<EndPlane> PlaneOfScan(const Scanned& any) {
  return FitEndPlane(any.samples, any.cut.r_mm, 3 * any.cut.r_mm, any.scan.noise_mm, false);
}

// Lines that many columns share say less than as many columns that do not know of each other.
// (Some ends were 15 sigma off.)
TEST(TiltedLines, OfACloudTellAnEndAsWellAsTheySay) {
  for (const double slope_deg : {0.0, 8.0}) {
    double at = 0, sum = 0, slopes = 0, count = 0;
    for (unsigned seed = 2001; seed <= 2120; ++seed) {
      SCOPED_TRACE(seed);
      const Scanned any = AnyScan(seed, slope_deg);
      const auto plane = PlaneOfScan(any);
      if (!plane) continue;  // thinned, many lines show on too little of the turn
      const double off = (plane->at_mm - any.cut.at_mm) / plane->at_sigma_mm;
      const double c = plane->cosine - any.cut.slope * std::cos(any.cut.to_rad);
      const double s = plane->sine - any.cut.slope * std::sin(any.cut.to_rad);
      EXPECT_LT(std::abs(off), 6);
      EXPECT_LT(std::hypot(c, s) / plane->slope_sigma, 8);
      at += off * off;
      sum += off;
      slopes += 0.5 * (c * c + s * s) / std::pow(plane->slope_sigma, 2);
      count += 1;
    }
    ASSERT_GT(count, 110);
    EXPECT_LT(std::abs(sum / count), 3 / std::sqrt(count)) << slope_deg;
    EXPECT_LT(std::sqrt(at / count), 1.3) << slope_deg;
    EXPECT_GT(std::sqrt(at / count), 0.7) << slope_deg;
    EXPECT_LT(std::sqrt(slopes / count), 1.3) << slope_deg;
    EXPECT_GT(std::sqrt(slopes / count), 0.7) << slope_deg;
  }
}

// No column contradicts a plane at the outermost point of a wave, but all together do.
TEST(TiltedLines, OfAWavyEndAreNoPlane) {
  int curves = 0, ends = 0;
  for (unsigned seed = 3001; seed <= 3030; ++seed) {
    SCOPED_TRACE(seed);
    Scanned any = AnyScan(seed, 0);
    Random random(seed);
    any.cut.wave_mm = 0.12 * any.cut.r_mm;
    any.samples = ScanLines(any.cut, any.scan, random);
    const auto plane = PlaneOfScan(any);
    if (!plane) continue;
    ends += 1;
    curves += plane->border.empty() ? 0 : 1;
  }
  EXPECT_GE(curves, 0.85 * ends);
}

// Where the border is steep a column's last line ends within it, further out than its middle does.
TEST(TiltedLines, OfAWavyEndTellItsPlaceAsWellAsTheySay) {
  double at = 0, sum = 0, count = 0, places = 0, of_places = 0;
  for (unsigned seed = 4001; seed <= 4060; ++seed) {
    SCOPED_TRACE(seed);
    Scanned any = AnyScan(seed, 0);
    Random random(seed);
    any.cut.waves = 2 + static_cast<int>(seed % 3);
    any.cut.wave_mm = Uniform(random, 0.06, 0.25) * any.cut.r_mm;
    any.samples = ScanLines(any.cut, any.scan, random);
    const auto plane = PlaneOfScan(any);
    if (!plane || plane->border.empty()) continue;
    const double off = (plane->at_mm - any.cut.at_mm) / plane->at_sigma_mm;
    at += off * off;
    sum += off;
    count += 1;
    for (const BorderPlace& place : plane->border) {
      const double wave_mm = any.cut.WaveMm(place.around_deg * hal::kRadiansPerDegree);
      places += std::pow((place.beyond_mm - wave_mm) / place.sigma_mm, 2);
      of_places += 1;
    }
  }
  ASSERT_GT(count, 45);
  EXPECT_LT(std::abs(sum / count), 3 / std::sqrt(count));
  EXPECT_LT(std::sqrt(at / count), 1.3);
  EXPECT_LT(std::sqrt(places / of_places), 1.3);
}

}  // namespace
}  // namespace bendloop::pipeline::tilted_lines
