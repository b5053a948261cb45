// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/dents.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include "tests/support/cut_walls.h"

namespace bendloop::pipeline {
namespace {

using tests::Uniform;

constexpr double kPipeRadiusMm = 8, kReachMm = 10, kWallNoiseMm = 0.03;

// The wall about a place; `in_mm`: how far it is pressed in there, `is_seen`: where it has points.
std::vector<WallPoint> WallOf(const std::function<double(double, double)>& in_mm,
                              const std::function<bool(double, double)>& is_seen) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> noise(0, kWallNoiseMm);
  std::vector<WallPoint> points;
  while (points.size() < 3000) {
    const double along = Uniform(random, -kReachMm, kReachMm);
    const double around = Uniform(random, -kReachMm, kReachMm);
    if (is_seen(along, around))
      points.push_back({along, around, noise(random) - in_mm(along, around)});
  }
  return points;
}

bool Everywhere(double, double) { return true; }

TEST(Dents, APlainWallShowsNone) {
  const auto plain = WallOf([](double, double) { return 0.0; }, Everywhere);
  // As deep as noise, and deeper than any point is.
  for (const double depth_mm : {0.03, 0.3}) {
    EXPECT_FALSE(IsShown(plain, kReachMm, depth_mm, 5, kPipeRadiusMm, kWallNoiseMm));
  }
  // Where the place itself was not seen, too.
  const auto beside =
      WallOf([](double, double) { return 0.0; }, [](double along, double) { return along > 5; });
  EXPECT_FALSE(IsShown(beside, kReachMm, 0.3, 5, kPipeRadiusMm, kWallNoiseMm));
}

// Behind an opening that was not told samples lie at all depths, and beside them on the wall.
TEST(Dents, ThereIsNoneWhereTheWallIsNotWhole) {
  std::mt19937_64 random(5);
  const auto whole = WallOf([](double, double) { return 0.0; }, Everywhere);
  std::vector<WallPoint> open;
  for (const WallPoint& point : whole) {
    const double from_mm = std::hypot(point.along_mm, point.around_mm);
    if (from_mm > 3) open.push_back(point);
    if (from_mm < 3 && from_mm > 1) {
      open.push_back({point.along_mm, point.around_mm, -Uniform(random, 0.0, 2.5)});
    }
  }
  for (const double depth_mm : {0.3, 0.6}) {
    EXPECT_FALSE(FitDent(open, kReachMm, depth_mm, 6, kPipeRadiusMm, kWallNoiseMm).is_fitted);
    EXPECT_FALSE(IsShown(open, kReachMm, depth_mm, 6, kPipeRadiusMm, kWallNoiseMm));
  }
}

// Half of the samples of an opening are of the bore, the others of the wall right beside it: in the
// middle between them lies no sample, and nothing is known exactly of a dent there.
TEST(Dents, WhatNoSampleTellsOfIsNotKnownExactly) {
  int bore = 0;
  const auto open = WallOf(
      [&bore](double along, double around) {
        return std::hypot(along, around) < 3 && ++bore % 2 == 0 ? 1.4 : 0.0;
      },
      Everywhere);
  for (const double depth_mm : {0.5, 0.6, 0.7}) {
    const FittedDent dent = FitDent(open, kReachMm, depth_mm, 6, kPipeRadiusMm, kWallNoiseMm);
    EXPECT_FALSE(dent.is_fitted);
    EXPECT_FALSE(IsShown(open, kReachMm, depth_mm, 6, kPipeRadiusMm, kWallNoiseMm));
    for (const double sigma :
         {dent.along_sigma_mm, dent.around_sigma_mm, dent.depth_sigma_mm, dent.area_sigma_mm2}) {
      EXPECT_GT(sigma, 0.001);
    }
  }
}

TEST(Dents, WhatIsPressedInIsShown) {
  const auto round = [](double along, double around) {
    return 0.3 * std::exp(-0.5 * (along * along + around * around) / 9);
  };
  // A crease, a flat along the tube and a dent's flank are no gaussians, yet there they are.
  const auto crease = [](double along, double) { return std::abs(along) < 0.8 ? 0.3 : 0.0; };
  const auto flat = [](double, double around) {
    return 0.3 * std::max(0.0, 1.0 - std::pow((around - 1) / 3, 2));
  };
  EXPECT_TRUE(IsShown(WallOf(round, Everywhere), kReachMm, 0.25, 6, kPipeRadiusMm, kWallNoiseMm));
  EXPECT_TRUE(IsShown(WallOf(crease, Everywhere), kReachMm, 0.2, 5, kPipeRadiusMm, kWallNoiseMm));
  EXPECT_TRUE(IsShown(WallOf(flat, Everywhere), kReachMm, 0.25, 7, kPipeRadiusMm, kWallNoiseMm));
  const auto flank =
      WallOf(round, [](double along, double around) { return along > 2 && around > 0; });
  EXPECT_TRUE(IsShown(flank, kReachMm, 0.15, 5, kPipeRadiusMm, kWallNoiseMm));
}

}  // namespace
}  // namespace bendloop::pipeline
