// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/one_die.h"

#include <gtest/gtest.h>

#include <cmath>
#include <iterator>
#include <span>
#include <utility>
#include <vector>

#include "pipeline/fit/easing_fit.h"
#include "tests/support/real_tube.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

// A scan of a tube whose bends ease over `easing_r` pipe radii, with each bend fitted by itself;
// `looks`: for easing first.
struct Scanned {
  Scanned(const hal::Tube& tube, double easing_r, bool looks = true,
          const tests::RealScan& scan = {}) {
    std::mt19937_64 random(4);
    tests::RealCloud cloud = tests::ScanRealTube(tube, {.easing_r = easing_r}, scan, random);
    points_mm = std::move(cloud.points_W);
    truth = std::move(cloud.truth);
    blocks = {{Eigen::Vector3d::Zero(), 1e3, points_mm}};
    SurfaceFit start;
    start.tube = tube;
    if (looks) options.easing = FindEasing(start, blocks, options).easing;
    solution = SolveWithBows(tube, blocks, options);
  }
  Scanned(const Scanned&) = delete;  // the blocks look at the points
  Scanned& operator=(const Scanned&) = delete;

  std::vector<Eigen::Vector3d> points_mm;
  hal::Tube truth;
  std::vector<PointBlock> blocks;
  SurfaceFitOptions options{.reach_mm = 1};
  BowedSolution solution;
};

// A bend of 20 degrees and 12 mm is 4 mm long, eased over 3.5 mm: its radius by itself is known to
// some millimetres.
TEST(OneDie, TellsTheRadiusOfShortBends) {
  hal::Tube tube = ThreeBends();
  for (std::size_t i = 0; i < 3; ++i) tube.program.rows[i].bend_radius_mm = 12;
  tube.program.rows[1].angle_deg = 20;
  Scanned scanned(tube, 0.7);
  BowedSolution& solution = scanned.solution;
  const double alone_mm = *solution.fit.sigma.rows[1].bend_radius_mm;
  TryOneDie(scanned.blocks, scanned.options, solution);
  EXPECT_GT(solution.fit.priors.radii_alike, 0);
  EXPECT_LT(*solution.fit.sigma.rows[1].bend_radius_mm, 0.5 * alone_mm);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(*solution.fit.tube.program.rows[i].bend_radius_mm, 12, 0.5);
  }
}

TEST(OneDie, TwoDiesStayTwo) {
  hal::Tube tube = ThreeBends();
  tube.program.rows[1].bend_radius_mm = 20;
  Scanned scanned(tube, 0.4);
  BowedSolution& solution = scanned.solution;
  TryOneDie(scanned.blocks, scanned.options, solution);
  EXPECT_EQ(solution.fit.priors.radii_alike, 0);
  EXPECT_NEAR(*solution.fit.tube.program.rows[1].bend_radius_mm, 20, 1.5);
}

// As if nobody had looked for easing, nor for bows.
BowedSolution SharpOf(const hal::Tube& tube, const Scanned& scanned) {
  BowedSolution solution;
  solution.fit = FitSurface(tube, scanned.blocks, scanned.options);
  solution.straight = solution.fit.tube;
  solution.bows.state = {solution.fit.tube, {}, {}, {}};
  solution.bows.noise_mm = solution.fit.sigma_mm;
  return solution;
}

hal::Tube BendsOf(std::span<const double> angles_deg, double bend_radius_mm) {
  hal::Tube tube = ThreeBends();
  const hal::BendRow last = tube.program.rows.back();
  tube.program.rows.clear();
  for (const double angle_deg : angles_deg) {
    tube.program.rows.push_back({45, 70, angle_deg, bend_radius_mm});
  }
  tube.program.rows.front().rotation_deg = 0;
  tube.program.rows.push_back(last);
  return tube;
}

// Of slight bends of one die easing makes wider sharp ones, and so hides: their radii tell it, the
// slighter the bend, the wider.
TEST(OneDie, FindsTheEasingThatRadiiHid) {
  const double angles_deg[] = {25, 60, 35, 90, 45};
  const hal::Tube tube = BendsOf(angles_deg, 14);
  Scanned scanned(tube, 0.4, false);
  BowedSolution solution = SharpOf(tube, scanned);
  EXPECT_GT(*solution.fit.tube.program.rows[0].bend_radius_mm, 14.25);
  TryOneDie(scanned.blocks, scanned.options, solution);
  EXPECT_FALSE(solution.fit.easing.empty());
  for (std::size_t i = 0; i < std::size(angles_deg); ++i) {
    EXPECT_NEAR(*solution.fit.tube.program.rows[i].bend_radius_mm, 14, 0.4) << i;
    EXPECT_NEAR(solution.fit.tube.program.rows[i].length_mm, 45,
                3 * solution.fit.sigma.rows[i].length_mm)
        << i;
  }
}

// Such radii are as alike as those of any die, and yet many times their sigmas too wide where the
// scan is good: each bend by itself explains the points as well as with its easing.
TEST(OneDie, FindsTheEasingOfBendsThatHardlyDiffer) {
  const double angles_deg[] = {57, 79, 92, 100, 66}, bend_radius_mm = 15;
  const hal::Tube tube = BendsOf(angles_deg, bend_radius_mm);
  const Scanned scanned(tube, 0.3, false, {.points = 60'000, .noise_mm = 0.01});
  BowedSolution solution = SharpOf(tube, scanned);
  EXPECT_GT(*solution.fit.tube.program.rows[0].bend_radius_mm, bend_radius_mm + 0.1);
  EXPECT_LT(*solution.fit.sigma.rows[0].bend_radius_mm, 0.05);
  TryOneDie(scanned.blocks, scanned.options, solution);
  for (std::size_t i = 0; i < std::size(angles_deg); ++i) {
    const hal::BendRow &is = solution.fit.tube.program.rows[i], &sigma = solution.fit.sigma.rows[i];
    EXPECT_NEAR(*is.bend_radius_mm, bend_radius_mm, 5 * *sigma.bend_radius_mm) << i;
    if (i > 0) {
      EXPECT_NEAR(is.length_mm, scanned.truth.program.rows[i].length_mm, 5 * sigma.length_mm) << i;
    }
    EXPECT_LT(*sigma.bend_radius_mm, 0.2) << i;
  }
}

// A bend that eases in and out linearly over more than its arc is, in its curvature along the
// spine, one of a wider die that eases over that arc: its radius was told to be twice what it was,
// with a sigma of a hundredth. What a fit leaves of the bends' sections spoke for that.
TEST(OneDie, TellsABendThatEasesOverMoreThanItsArc) {
  const double bend_radius_mm = 15;
  hal::Tube tube = ThreeBends();
  tube.pipe_radius_mm = 7.4;
  tube.program.rows = {{102, 0, 86, bend_radius_mm},
                       {98, 54, 30.5, bend_radius_mm},
                       {83, 8, 75.5, bend_radius_mm},
                       {94, 158, 69, bend_radius_mm},
                       {97, 0, 0, {}}};
  std::mt19937_64 random(1);
  const auto cloud = tests::ScanRealTube(tube, {.easing_r = 1.075, .ramps = true, .ovality = 0.01},
                                         {.points = 60'000, .noise_mm = 0.003}, random);
  const std::vector<PointBlock> blocks = {{Eigen::Vector3d::Zero(), 1e3, cloud.points_W}};
  SurfaceFitOptions options{.reach_mm = 1.5};
  options.flattened = true;
  const double eased_mm2 = std::pow(2 * 1.075 * tube.pipe_radius_mm, 2) / 12;
  const double arc_mm2 = VarianceOfArc(tube.program.rows[1]) * bend_radius_mm * bend_radius_mm;
  options.easing.variance_mm2.assign(4, eased_mm2);
  options.easing.variance_mm2[1] = arc_mm2;
  const auto wide =
      WithBendRadii(tube, std::sqrt(eased_mm2 / VarianceOfArc(tube.program.rows[1])), 1);
  ASSERT_TRUE(wide);
  BowedSolution solution = SolveWithBows(*wide, blocks, options);
  ASSERT_GT(*solution.fit.tube.program.rows[1].bend_radius_mm, 25);
  TryOneDie(blocks, options, solution);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(*solution.fit.tube.program.rows[i].bend_radius_mm, bend_radius_mm, 0.5) << i;
  }
}

// Radii that differ for another reason stay what they are.
TEST(OneDie, RadiiThatDoNotFollowTheAngleStay) {
  const double angles_deg[] = {57, 79, 92, 100, 66};
  hal::Tube tube = BendsOf(angles_deg, 10.1);
  const double more_mm[] = {0.1, -0.1, 0.1, -0.1, -0.1};
  for (std::size_t i = 0; i < std::size(more_mm); ++i) {
    *tube.program.rows[i].bend_radius_mm += more_mm[i];
  }
  const Scanned scanned(tube, 0, false, {.points = 60'000, .noise_mm = 0.01});
  BowedSolution solution = SharpOf(tube, scanned);
  TryOneDie(scanned.blocks, scanned.options, solution);
  EXPECT_TRUE(solution.fit.easing.empty());
  for (std::size_t i = 0; i < std::size(more_mm); ++i) {
    EXPECT_NEAR(*solution.fit.tube.program.rows[i].bend_radius_mm, 10.1 + more_mm[i], 0.02) << i;
  }
}

}  // namespace
}  // namespace bendloop::pipeline
