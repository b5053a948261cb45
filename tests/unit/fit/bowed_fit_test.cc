// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/bowed_fit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "hal/spine.h"
#include "pipeline/reconstruction.h"
#include "tests/support/error_sigmas.h"
#include "tests/support/real_tube.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

// A bow of L/300 is ten times the noise here: it must move neither the pipe radius nor the end of a
// straight, which the samples' spine had not reached.
TEST(BowedFit, DistancesAreFromTheBowedTube) {
  std::mt19937_64 random(11);
  hal::Tube tube = ThreeBends();
  tube.program.rows[1].length_mm = 150;
  const auto cloud =
      tests::ScanRealTube(tube, {.bow = 1.0 / 300}, {.points = 30'000, .noise_mm = 0.02}, random);
  const std::vector<PointBlock> blocks = {{Eigen::Vector3d::Zero(), 1e3, cloud.points_W}};
  hal::Tube seen = tube;
  seen.program.rows.back().length_mm -= 8;
  const SurfaceFitOptions options{.reach_mm = 1};
  SurfaceFit fit = FitSurface(seen, blocks, options);
  const BowedFit bows = FitBows(blocks, options, fit);
  EXPECT_NEAR(bows.noise_mm, 0.02, 0.001);
  EXPECT_NEAR(fit.tube.pipe_radius_mm, 5, 4 * fit.pipe_radius_sigma_mm);
  EXPECT_LT(fit.pipe_radius_sigma_mm, 0.001);
  for (std::size_t i = 0; i < 3; ++i) {
    const auto &is = fit.tube.program.rows[i], &was = cloud.truth.program.rows[i];
    EXPECT_NEAR(is.angle_deg, was.angle_deg, 4 * fit.sigma.rows[i].angle_deg);
    if (i == 0) continue;
    EXPECT_NEAR(is.rotation_deg, was.rotation_deg, 4 * fit.sigma.rows[i].rotation_deg);
    EXPECT_NEAR(is.length_mm, was.length_mm, 4 * fit.sigma.rows[i].length_mm);
  }
}

// Whether L, R, A and radii are the scanned tube's, within so many sigma. As ends are seen by where
// points stop, they are left out.
void ExpectRowsOf(const tests::RealCloud& cloud, const Measurement& found, double sigmas,
                  double most_sigma_deg = 0.05) {
  const auto& rows = found.tube.program.rows;
  const std::size_t bends = cloud.truth.program.bend_count();
  ASSERT_EQ(rows.size(), bends + 1);
  const bool reversed = std::abs(rows[0].angle_deg - cloud.truth.program.rows[0].angle_deg) > 5;
  for (std::size_t i = 0; i < bends; ++i) {
    SCOPED_TRACE(i);
    const std::size_t k = reversed ? bends - 1 - i : i;
    const auto& was = cloud.truth.program.rows[i];
    const auto& sigma = found.sigma.rows[k];
    EXPECT_LT(std::abs(*rows[k].bend_radius_mm - *was.bend_radius_mm),
              sigmas * *sigma.bend_radius_mm);
    EXPECT_LT(std::abs(rows[k].angle_deg - was.angle_deg), sigmas * sigma.angle_deg);
    // Lines and arcs alone leave a tenth of a degree and more at L/300.
    EXPECT_LT(sigma.angle_deg, most_sigma_deg);
    if (i == 0) continue;
    const std::size_t row = reversed ? bends - i : i;
    EXPECT_LT(std::abs(rows[row].length_mm - was.length_mm),
              sigmas * found.sigma.rows[row].length_mm);
    EXPECT_LT(std::abs(hal::WrapRotationDeg(rows[row].rotation_deg - was.rotation_deg)),
              sigmas * found.sigma.rows[row].rotation_deg);
  }
}

TEST(BowedFit, RowsOfBowedTubesAreThoseOfTheBestFitLines) {
  for (const double bow : {1.0 / 1000, 1.0 / 300}) {
    SCOPED_TRACE(bow);
    std::mt19937_64 random(7);
    const auto cloud =
        tests::ScanRealTube(ThreeBends(), {.bow = bow, .s_bow = 0.3 * bow}, {}, random);
    const auto found = Reconstruct(cloud.points_W, {}, kClock);
    ASSERT_TRUE(found) << found.error().message;
    ExpectRowsOf(cloud, *found, 4);
  }
}

// The bends beside it leave little of it; it bows all the same. (Taken for straight a bend radius
// is 10 sigma off.)
TEST(BowedFit, AShortStraightBetweenEasedBendsBows) {
  std::mt19937_64 random(2);
  hal::Tube tube = ThreeBends();
  tube.program.rows[2].length_mm = 21;
  const tests::Form form{.bow = 1.0 / 500, .s_bow = 1.0 / 2000, .easing_r = 0.5};
  const auto cloud = tests::ScanRealTube(tube, form, {.points = 30'000, .noise_mm = 0.03}, random);
  const auto found = Reconstruct(cloud.points_W, {}, kClock);
  ASSERT_TRUE(found) << found.error().message;
  ExpectRowsOf(cloud, *found, 5);
}

// However short a straight is, beside others that bow it does: the bends beside it take its bow for
// their own, and its lines' angles are as unsure as that. (Taken for straight an angle is up to
// 0.57 degrees off, 17 of its sigmas.)
TEST(BowedFit, AStraightOfAPipeRadiusBowsAsOthersDo) {
  hal::Tube tube = ThreeBends();
  tube.program.rows[2].length_mm = 7;
  const tests::Form form{.bow = 1.0 / 320, .s_bow = 1.0 / 3000};
  for (const unsigned seed : {1U, 2U, 3U}) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    const auto cloud =
        tests::ScanRealTube(tube, form, {.points = 30'000, .noise_mm = 0.03}, random);
    const auto found = Reconstruct(cloud.points_W, {}, kClock);
    ASSERT_TRUE(found) << found.error().message;
    ExpectRowsOf(cloud, *found, 4, 0.3);
  }
}

// What bends hardly ease over and what straights hardly bow by look alike: where samples speak for
// one about as well as for the other, rows are as unsure as both are apart. (By the likelier alone
// radii and lengths were 3.2 of their sigmas off, root mean square; now 2.3.)
TEST(BowedFit, IsUnsureWhereBowsMayBeEasing) {
  const hal::Tube tube = FiveBends();
  const tests::Form form{.bow = 1.0 / 1500, .s_bow = 1.0 / 6000, .easing_r = 0.07};
  double squares = 0, count = 0;
  for (unsigned seed = 1; seed <= 6; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    const auto cloud =
        tests::ScanRealTube(tube, form, {.points = 24'000, .noise_mm = 0.005}, random);
    const auto found = Reconstruct(cloud.points_W, {}, kClock);
    ASSERT_TRUE(found) << found.error().message;
    const auto &rows = found->tube.program.rows, &was = cloud.truth.program.rows;
    ASSERT_EQ(rows.size(), was.size());
    const bool is_reversed = rows[0].angle_deg < 40;
    for (std::size_t i = 0; i < 5; ++i) {
      const std::size_t bend = is_reversed ? 4 - i : i, row = is_reversed ? 5 - i : i;
      squares += std::pow((*rows[bend].bend_radius_mm - *was[i].bend_radius_mm) /
                              *found->sigma.rows[bend].bend_radius_mm,
                          2);
      count += 1;
      if (i == 0) continue;
      squares +=
          std::pow((rows[row].length_mm - was[i].length_mm) / found->sigma.rows[row].length_mm, 2);
      count += 1;
    }
  }
  EXPECT_LT(std::sqrt(squares / count), 2.6);
}

// Dents have no say beside a bowed and eased tube, and much of it beside lines and arcs: what loses
// their points has not lost its way, nor what once steps too far and comes back. (Taken for lost,
// their bends were sharp.)
TEST(BowedFit, LosesThePointsOfDentsOnly) {
  // The second dent on either side of the bend in the middle.
  for (const double second : {0.36, 0.64}) {
    const tests::Form form{.bow = 1.0 / 400,
                           .s_bow = 1.0 / 4000,
                           .easing_r = second < 0.5 ? 0.57 : 0.4,
                           .dents = {{.along = 0.2, .around_rad = 1.5, .depth_r = 0.16},
                                     {.along = second, .around_rad = -1.9, .depth_r = 0.1},
                                     {.along = 0.85, .around_rad = 0.3, .depth_r = 0.12}}};
    for (const unsigned seed : {1U, 2U, 3U}) {
      SCOPED_TRACE(testing::Message() << second << " seed " << seed);
      std::mt19937_64 random(seed);
      const auto cloud =
          tests::ScanRealTube(ThreeBends(), form, {.points = 30'000, .noise_mm = 0.02}, random);
      const auto found = Reconstruct(cloud.points_W, {}, kClock);
      ASSERT_TRUE(found) << found.error().message;
      EXPECT_FALSE(found->easing.empty());
      ExpectRowsOf(cloud, *found, 5);
    }
  }
}

// Radius, easing and bows of a slight bend are hardly told apart: a solution that is taken before
// it rests is far from where it would come to. (Where one step had to do, radii and lengths of such
// tubes were up to 12 sigma off, and sharp bends were taken for likelier than eased ones.)
TEST(BowedFit, RestsBeforeItIsTaken) {
  hal::Tube tube = ThreeBends();
  tube.program.rows = {{33, 0, 20, 19},   {68, -149, 50, 19}, {48, 78, 86, 19},
                       {21, -97, 56, 19}, {37, -39, 76, 19},  {25, 0, 0, {}}};
  const tests::Form form{.bow = 1.0 / 2000, .s_bow = 1.0 / 10000, .easing_r = 0.12, .ramps = true};
  for (const unsigned seed : {1U, 2U, 3U}) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    const auto cloud =
        tests::ScanRealTube(tube, form, {.points = 24'000, .noise_mm = 0.005}, random);
    const auto found = Reconstruct(cloud.points_W, {}, kClock);
    ASSERT_TRUE(found) << found.error().message;
    EXPECT_FALSE(found->easing.empty());
    ExpectRowsOf(cloud, *found, 5);
  }
}

// Where a bend eases the straight beside it bows on, and the bend's last turn is within the part
// that the best-fit line is of: without either, angles and rotations are off by two to three times
// as much.
TEST(BowedFit, BowsGoOnWhereBendsEase) {
  double squares_deg2 = 0;
  int values = 0;
  for (int seed = 1; seed <= 6; ++seed) {
    std::mt19937_64 random(static_cast<std::uint64_t>(seed));
    hal::Tube tube = ThreeBends();
    for (std::size_t i = 0; i < 3; ++i) tube.program.rows[i].bend_radius_mm = 14;
    const auto cloud = tests::ScanRealTube(tube, {.bow = 1.0 / 700, .easing_r = 0.7},
                                           {.points = 60'000, .noise_mm = 0.01}, random);
    const auto found = Reconstruct(cloud.points_W, {}, kClock);
    ASSERT_TRUE(found.has_value());
    const auto &is = found->tube.program.rows, &was = cloud.truth.program.rows;
    ASSERT_EQ(is.size(), was.size());
    const bool reversed = std::abs(is[0].angle_deg - was[0].angle_deg) > 5;
    for (std::size_t i = 0; i < 3; ++i) {
      squares_deg2 += std::pow(is[reversed ? 2 - i : i].angle_deg - was[i].angle_deg, 2);
      ++values;
      if (i == 0) continue;
      const double off_deg =
          hal::WrapRotationDeg(is[reversed ? 3 - i : i].rotation_deg - was[i].rotation_deg);
      squares_deg2 += off_deg * off_deg;
      ++values;
    }
  }
  EXPECT_LT(std::sqrt(squares_deg2 / values), 0.006);
}

// Where a slight bend begins samples hardly tell, and which part of a bow a best-fit line is of
// turns with it.
TEST(BowedFit, BestFitLinesAreAsSureAsWhereTheirStraightsBegin) {
  double squares = 0;
  int values = 0;
  for (int seed = 1; seed <= 4; ++seed) {
    std::mt19937_64 random(static_cast<std::uint64_t>(seed));
    hal::Tube tube = ThreeBends();
    tube.program.rows = {
        {45, 0, 60, 15}, {40, 80, 16, 15}, {38, -120, 18, 15}, {50, 60, 70, 15}, {50, 0, 0, {}}};
    const auto cloud = tests::ScanRealTube(tube, {.bow = 1.0 / 350, .easing_r = 0.8},
                                           {.points = 60'000, .noise_mm = 0.005}, random);
    const auto found = Reconstruct(cloud.points_W, {}, kClock);
    ASSERT_TRUE(found.has_value());
    const auto &is = found->tube.program.rows, &was = cloud.truth.program.rows;
    const auto& sigma = found->sigma.rows;
    ASSERT_EQ(is.size(), was.size());
    const bool reversed = std::abs(is[0].angle_deg - was[0].angle_deg) > 5;
    for (std::size_t i = 0; i < 4; ++i) {
      const std::size_t row = reversed ? 3 - i : i;
      const double z = (is[row].angle_deg - was[i].angle_deg) / sigma[row].angle_deg;
      squares += z * z;
      ++values;
    }
  }
  EXPECT_LT(std::sqrt(squares / values), 1.5);
}

// What springs back between two bends is bowed like half a sine rather than like a parabola, which
// turns its ends, where the bends go on. (By the parabola and the cubic alone rotations are off by
// 0.014 degrees, and known to 0.013.)
TEST(BowedFit, HalfASineIsNoParabola) {
  const tests::Form form{.bow = 1.0 / 500, .half_sine = true};
  tests::ErrorSigmas of_angles, of_rotations;
  for (unsigned seed = 1; seed <= 12; ++seed) {
    std::mt19937_64 random(seed);
    const auto cloud =
        tests::ScanRealTube(FiveBends(), form, {.points = 60'000, .noise_mm = 0.01}, random);
    const std::vector<PointBlock> blocks = {{Eigen::Vector3d::Zero(), 1e3, cloud.points_W}};
    const SurfaceFitOptions options{.reach_mm = kReachMm};
    SurfaceFit fit = FitSurface(cloud.truth, blocks, options);
    FitBows(blocks, options, fit);
    const auto &rows = fit.tube.program.rows, &was = cloud.truth.program.rows;
    for (std::size_t i = 0; i < 5; ++i) {
      const auto& sigma = fit.sigma.rows[i];
      of_angles.Add(rows[i].angle_deg - was[i].angle_deg, sigma.angle_deg);
      if (i == 0) continue;
      of_rotations.Add(hal::WrapRotationDeg(rows[i].rotation_deg - was[i].rotation_deg),
                       sigma.rotation_deg);
      EXPECT_LT(sigma.rotation_deg, 0.009) << "seed " << seed << " row " << i;
    }
  }
  EXPECT_LT(of_angles.rms(), 1.25);
  EXPECT_LT(of_rotations.rms(), 1.25);
}

// A bow of 4 um at a noise of 30: a thirtieth of the points does not show it, and all of them know
// angles to a fifth of what it turns.
TEST(BowedFit, ManyPointsShowWhatFewDoNot) {
  std::mt19937_64 random(5);
  const auto cloud = tests::ScanRealTube(ThreeBends(), {.bow = 1.0 / 12000},
                                         {.points = 600'000, .noise_mm = 0.03}, random);
  const std::vector<PointBlock> blocks = {{Eigen::Vector3d::Zero(), 1e3, cloud.points_W}};
  const SurfaceFitOptions options{.reach_mm = 1};
  SurfaceFit fit = FitSurface(ThreeBends(), blocks, options);
  FitBows(blocks, options, fit);
  double squares = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto &is = fit.tube.program.rows[i], &was = cloud.truth.program.rows[i];
    squares += std::pow((is.angle_deg - was.angle_deg) / fit.sigma.rows[i].angle_deg, 2);
    if (i == 0) continue;
    squares += std::pow((is.rotation_deg - was.rotation_deg) / fit.sigma.rows[i].rotation_deg, 2);
  }
  EXPECT_LT(std::sqrt(squares / 5), 2.5);
}

// Samples tell next to nothing of the radius of a slight bend, and beside bows it may come out as
// tight as the pipe: what its derivative says there is no certainty.
TEST(BowedFit, KnowsNoRadiusOfASlightBend) {
  hal::Tube tube = ThreeBends();
  tube.program.rows = {{65, 0, 70, 19},   {63, 133, 3, 19},  {61, -78, 83, 19},
                       {48, 39, 3.2, 19}, {60, 147, 20, 19}, {47, 0, 0, {}}};
  int vague = 0;
  for (int seed = 14; seed <= 36; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    const auto cloud = tests::ScanRealTube(tube, {.bow = 0.0008, .s_bow = 0.0002}, {}, random);
    const std::vector<PointBlock> blocks = {{Eigen::Vector3d::Zero(), 1e3, cloud.points_W}};
    const SurfaceFitOptions options{.reach_mm = 1};
    SurfaceFit fit = FitSurface(tube, blocks, options);
    FitBows(blocks, options, fit);
    for (const std::size_t i : {std::size_t{1}, std::size_t{3}}) {
      const auto &is = fit.tube.program.rows[i], &was = cloud.truth.program.rows[i];
      EXPECT_NEAR(*is.bend_radius_mm, *was.bend_radius_mm, 4 * *fit.sigma.rows[i].bend_radius_mm);
      EXPECT_NEAR(is.length_mm, was.length_mm, 4 * fit.sigma.rows[i].length_mm);
      vague += *fit.sigma.rows[i].bend_radius_mm > 30 ? 1 : 0;
    }
  }
  EXPECT_LE(vague, 5) << "of 46";
}

// Every straight bows by half a wave from end to end, by L/1500 to L/500 to any side, and so meets
// its bends at an angle.
void BowAtAnAngle(const hal::Tube& tube, std::mt19937_64& random,
                  std::vector<Eigen::Vector3d>& points_mm) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  std::vector<Eigen::Vector3d> bows_mm(segments.size());
  for (std::size_t k = 0; k < segments.size(); k += 2) {
    const double to = std::uniform_real_distribution<double>(-3.14, 3.14)(random);
    const double part = std::uniform_real_distribution<double>(1.0 / 1500, 1.0 / 500)(random);
    bows_mm[k] = part * segments[k].length_mm *
                 (segments[k].axes() * Eigen::Vector3d(0, std::cos(to), std::sin(to)));
  }
  for (Eigen::Vector3d& point : points_mm) {
    for (std::size_t k = 0; k < segments.size(); k += 2) {
      const Eigen::Vector3d from_mm =
          segments[k].axes().transpose() * (point - segments[k].start_mm);
      const double part = from_mm.x() / segments[k].length_mm;
      if (part < 0 || part > 1 || from_mm.tail<2>().norm() > 2 * tube.pipe_radius_mm) continue;
      point += std::sin(std::numbers::pi * part) * bows_mm[k];
    }
  }
}

// No shape of a bow explains all of that, and the straights bow all the same. Their best-fit lines
// lie beside the tube's, which moves corners, and go the same way.
TEST(BowedFit, BowsThatMeetTheBendsAtAnAngle) {
  hal::Tube tube = ThreeBends();
  tube.program.rows = {{44, 0, 83, 16.4},
                       {38, -130, 106, 16.4},
                       {68, -115, 116, 16.4},
                       {31, 151, 33, 16.4},
                       {24, 0, 0, {}}};
  for (const unsigned seed : {5U, 7U, 19U}) {
    std::mt19937_64 random(5), of_bows(seed);
    auto cloud = tests::ScanRealTube(tube, {}, {.points = 16'000, .noise_mm = 0.018}, random);
    BowAtAnAngle(tube, of_bows, cloud.points_W);
    const auto found = Reconstruct(cloud.points_W, {}, kClock);
    ASSERT_TRUE(found);
    const auto &is = found->tube.program.rows, &sigma = found->sigma.rows;
    ASSERT_EQ(is.size(), 5u);
    const bool reversed = std::abs(is[0].angle_deg - 83) > 5;
    for (std::size_t i = 0; i < 4; ++i) {
      SCOPED_TRACE(i);
      const std::size_t k = reversed ? 3 - i : i;
      EXPECT_NEAR(is[k].angle_deg, tube.program.rows[i].angle_deg, 4 * sigma[k].angle_deg);
      EXPECT_LT(sigma[k].angle_deg, 0.05);
      if (i == 0) continue;
      const std::size_t row = reversed ? 4 - i : i;
      EXPECT_NEAR(is[row].rotation_deg, tube.program.rows[i].rotation_deg,
                  4 * sigma[row].rotation_deg);
    }
  }
}

TEST(BowedFit, LeavesStraightStraightsAlone) {
  std::mt19937_64 random(7);
  const auto cloud = tests::ScanRealTube(ThreeBends(), {}, {}, random);
  std::vector<PointBlock> blocks = {{Eigen::Vector3d::Zero(), 1e3, cloud.points_W}};
  const SurfaceFitOptions options{.reach_mm = 1};
  const SurfaceFit straight = FitSurface(ThreeBends(), blocks, options);
  SurfaceFit fit = straight;
  FitBows(blocks, options, fit);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(fit.tube.program.rows[i].angle_deg, straight.tube.program.rows[i].angle_deg);
    EXPECT_LT(fit.sigma.rows[i].angle_deg, 1.3 * straight.sigma.rows[i].angle_deg);
  }
}

}  // namespace
}  // namespace bendloop::pipeline
