// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/dent_fit.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <iterator>
#include <numbers>
#include <random>
#include <vector>

#include "tests/support/cut_walls.h"

namespace bendloop::pipeline {
namespace {

using tests::Uniform;

constexpr double kPi = std::numbers::pi;
constexpr double kPipeRadiusMm = 8, kReachMm = 10, kWallNoiseMm = 0.03;

// The wall about a place; `in_mm`: how far it is pressed in there, `is_seen`: where it has points.
std::vector<WallPoint> WallOf(const std::function<double(double, double)>& in_mm,
                              const std::function<bool(double, double)>& is_seen,
                              std::uint64_t seed = 3) {
  std::mt19937_64 random(seed);
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

// Cells have the mean of a dent's middle and its flanks: points that are much deeper than that are
// its middle.
TEST(Dents, AreAsDeepAsTheyAreHoweverShallowCellsSawThem) {
  constexpr int kDents = 40;
  std::mt19937_64 random(11);
  double depth2 = 0, area2 = 0;
  for (int i = 0; i < kDents; ++i) {
    const double deep_mm = Uniform(random, 0.3, 1.2), wide_mm = Uniform(random, 1.5, 3);
    const auto round = [&](double along, double around) {
      return deep_mm * std::exp(-0.5 * (along * along + around * around) / (wide_mm * wide_mm));
    };
    const double seen_mm = Uniform(random, 0.2, 0.35) * deep_mm;
    const FittedDent dent = FitDent(WallOf(round, Everywhere, random()), kReachMm, seen_mm,
                                    3.5 * wide_mm, kPipeRadiusMm, kWallNoiseMm);
    ASSERT_TRUE(dent.is_fitted);
    const double area_mm2 = 2 * std::numbers::pi * std::numbers::ln2 * wide_mm * wide_mm;
    depth2 += std::pow((dent.depth_mm - deep_mm) / dent.depth_sigma_mm, 2) / kDents;
    area2 += std::pow((dent.area_mm2 - area_mm2) / dent.area_sigma_mm2, 2) / kDents;
  }
  EXPECT_LT(std::sqrt(depth2), 1.3);
  EXPECT_LT(std::sqrt(area2), 1.3);
}

// How deep a dent of 1 mm is where q is the square of the distance from its middle over its width;
// half_q: where it is half as deep.
struct PressedForm {
  const char* name;
  std::function<double(double)> in_mm;
  double half_q;
};

// Of errors over sigma.
struct DentErrors {
  double place2 = 0, depth2 = 0, area2 = 0;

  void Add(const FittedDent& dent, const Eigen::Vector2d& middle_mm, double deep_mm,
           double area_mm2) {
    place2 += 0.5 * (std::pow((dent.along_mm - middle_mm.x()) / dent.along_sigma_mm, 2) +
                     std::pow((dent.around_mm - middle_mm.y()) / dent.around_sigma_mm, 2));
    depth2 += std::pow((dent.depth_mm - deep_mm) / dent.depth_sigma_mm, 2);
    area2 += std::pow((dent.area_mm2 - area_mm2) / dent.area_sigma_mm2, 2);
  }
};

// A ball presses a gaussian, an edge a flat; a wall that a blow has dragged along is no gaussian
// further out, and a hard one leaves a rim where the dent ends. Of neither were depths and areas
// known as well as they said until their tail was fitted: 6 to 12 of their sigmas off.
TEST(Dents, AreKnownAsWellAsTheySayInEachForm) {
  constexpr int kEach = 40;
  const PressedForm forms[] = {
      {"gaussian", [](double q) { return std::exp(-0.5 * q); }, 2 * std::numbers::ln2},
      {"flat", [](double q) { return std::exp(-0.25 * q * q); }, 2 * std::sqrt(std::numbers::ln2)},
      {"dragged", [](double q) { return 1 / (1 + q * q); }, 1},
      {"raised cosine",
       [](double q) { return q < 4 ? 0.5 + 0.5 * std::cos(0.5 * kPi * std::sqrt(q)) : 0.0; }, 1},
      {"cap", [](double q) { return std::max(0.0, 1 - 0.5 * q); }, 1}};
  std::mt19937_64 random(11);
  double all2 = 0;
  for (const PressedForm& form : forms) {
    SCOPED_TRACE(form.name);
    DentErrors errors;
    for (int i = 0; i < kEach; ++i) {
      const double deep_mm = Uniform(random, 0.15, 1.2), wide_mm = Uniform(random, 1.5, 3);
      const double longer = Uniform(random, 1, 1.6), axis_rad = Uniform(random, 0, 3);
      const Eigen::Vector2d middle_mm(Uniform(random, -1, 1), Uniform(random, -1, 1));
      const Eigen::Vector2d axis(std::cos(axis_rad), std::sin(axis_rad));
      const auto in_mm = [&](double along, double around) {
        const Eigen::Vector2d from = Eigen::Vector2d(along, around) - middle_mm;
        const double beside = axis.x() * from.y() - axis.y() * from.x();
        return deep_mm * form.in_mm((std::pow(from.dot(axis) / longer, 2) + beside * beside) /
                                    (wide_mm * wide_mm));
      };
      const FittedDent dent = FitDent(WallOf(in_mm, Everywhere, random()), kReachMm, 0.4 * deep_mm,
                                      3 * wide_mm, kPipeRadiusMm, kWallNoiseMm);
      ASSERT_TRUE(dent.is_fitted);
      errors.Add(dent, middle_mm, deep_mm,
                 std::numbers::pi * form.half_q * longer * wide_mm * wide_mm);
    }
    for (const double square : {errors.place2, errors.depth2, errors.area2}) {
      // A gaussian is just what is expected before the scan: off by less than what others are.
      EXPECT_GT(std::sqrt(square / kEach), 0.6);
      EXPECT_LT(std::sqrt(square / kEach), 1.3);
      all2 += square / kEach / (3 * std::size(forms));
    }
  }
  EXPECT_GT(std::sqrt(all2), 0.85);
  EXPECT_LT(std::sqrt(all2), 1.15);
}

// The wall of a hole falls at once; that of the flattest flat does not.
TEST(Dents, AStepIsNotFitted) {
  const auto fitted = [](const std::function<double(double)>& in_mm) {
    const auto wall = WallOf(
        [&](double along, double around) { return in_mm(std::hypot(along, around)); }, Everywhere);
    return FitDent(wall, kReachMm, 0.5, 6, kPipeRadiusMm, kWallNoiseMm);
  };
  const FittedDent step = fitted([](double from_mm) { return from_mm < 3 ? 0.8 : 0.0; });
  EXPECT_TRUE(step.is_step);
  EXPECT_FALSE(step.is_fitted);
  const FittedDent flat =
      fitted([](double from_mm) { return 0.8 * std::exp2(-std::pow(from_mm / 3, 6)); });
  EXPECT_FALSE(flat.is_step);
  EXPECT_TRUE(flat.is_fitted);
}

// What is pressed in by a block has a flat bottom, and flanks that are as steep as metal is drawn.
TEST(Dents, WithFlatBottomsAreNoSteps) {
  constexpr int kEach = 60;
  std::mt19937_64 random(23);
  DentErrors errors;
  for (int i = 0; i < kEach; ++i) {
    const double wide_mm = Uniform(random, 2, 4), flank_mm = Uniform(random, 0.3, 0.8) * wide_mm;
    const double slope = Uniform(random, 0.2, 1), deep_mm = slope * flank_mm * 2 / kPi;
    const auto block = [&](double along, double around) {
      const double inside = (wide_mm - std::hypot(along, around)) / flank_mm;
      return deep_mm * (0.5 + 0.5 * std::sin(kPi * std::clamp(inside, -0.5, 0.5)));
    };
    const FittedDent dent = FitDent(WallOf(block, Everywhere, random()), kReachMm, 0.7 * deep_mm,
                                    2 * wide_mm, kPipeRadiusMm, kWallNoiseMm);
    ASSERT_TRUE(dent.is_fitted) << deep_mm << " mm deep, " << wide_mm << ", slope " << slope;
    errors.Add(dent, {0, 0}, deep_mm, kPi * wide_mm * wide_mm);
  }
  for (const double square : {errors.place2, errors.depth2, errors.area2}) {
    EXPECT_GT(std::sqrt(square / kEach), 0.6);
    EXPECT_LT(std::sqrt(square / kEach), 1.3);
  }
}

// A jaw leaves a flat: a plane across, as long as the jaw is wide, and no ellipse, which is
// certainly not its form.
TEST(Dents, OfJawsAreFlats) {
  constexpr int kEach = 60;
  std::mt19937_64 random(31);
  DentErrors errors;
  double misfit = 0;
  for (int i = 0; i < kEach; ++i) {
    const double half_mm = Uniform(random, 2, 5), edge_mm = Uniform(random, 0.5, 1);
    const double deep_mm = Uniform(random, 0.2, 1);
    const Eigen::Vector2d middle_mm(Uniform(random, -1, 1), Uniform(random, -1, 1));
    const auto jaw = [&](double at_along, double at_around) {
      const double along = at_along - middle_mm.x();
      const double across = (at_around - middle_mm.y()) / kPipeRadiusMm;
      const double plane_mm = kPipeRadiusMm - (kPipeRadiusMm - deep_mm) / std::cos(across);
      const double in = std::clamp((half_mm - std::abs(along)) / edge_mm, -0.5, 0.5);
      return std::max(0.0, plane_mm) * (0.5 + 0.5 * std::sin(kPi * in));
    };
    const FittedDent dent = FitDent(WallOf(jaw, Everywhere, random()), kReachMm, 0.7 * deep_mm,
                                    2 * half_mm, kPipeRadiusMm, kWallNoiseMm);
    ASSERT_TRUE(dent.is_fitted);
    double area_mm2 = 0;
    for (double along = -8; along < 8; along += 0.05) {
      for (double around = -8; around < 8; around += 0.05) {
        area_mm2 += jaw(along, around) >= 0.5 * deep_mm ? 0.05 * 0.05 : 0;
      }
    }
    errors.Add(dent, middle_mm, deep_mm, area_mm2);
    misfit += dent.misfit / kEach;
  }
  EXPECT_LT(misfit, 1.1);
  for (const double square : {errors.place2, errors.depth2, errors.area2}) {
    EXPECT_LT(std::sqrt(square / kEach), 1.3);
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
