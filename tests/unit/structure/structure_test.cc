// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "hal/clock.h"
#include "hal/spine.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/reconstruction.h"
#include "pipeline/structure/structure_moves.h"
#include "pipeline/structure/structure_window.h"
#include "tests/support/synthetic_cloud.h"

namespace bendloop::pipeline {
namespace {

using Points = std::vector<Eigen::Vector3d>;

hal::BendProgram FoundIn(const Points& points) {
  const hal::SteadyClock clock;
  const auto measured = Reconstruct(points, {}, clock);
  if (!measured) {
    ADD_FAILURE() << measured.error().message;
    return {};
  }
  return measured->tube.program;
}

// Two slight bends one after the other in planes across: their lines miss each other by half a
// millimetre, and one bend in their place explains nearly all points.
TEST(Structure, TellsSlightBendsWithoutAStraightBetween) {
  hal::Tube tube;
  tube.pipe_radius_mm = 12.7;
  tube.program.rows = {{164, 0, 4.5, 75.5},    {68, -47, 4.7, 75.5}, {0, 103, 6.1, 75.5},
                       {138, -125, 7.6, 75.5}, {188, 27, 3.1, 75.5}, {78, 0, 0, std::nullopt}};
  std::mt19937_64 random(120);
  const Points points = tests::SyntheticCloud(tube, {.points = 3400, .noise_mm = 0.056}, random);
  EXPECT_EQ(FoundIn(points).bend_count(), 5U);
}

// What the points say of them is little beside a bow of a hundredth of a millimetre in every
// straight, which one bend in their place would ask for.
TEST(Structure, TakesNoBowsForSlightBendsWithoutAStraightBetween) {
  struct Case {
    double pipe_radius_mm, noise_mm;
    std::size_t points;
    std::vector<hal::BendRow> rows;
  };
  const std::vector<Case> cases = {
      {10.8,
       0.09,
       9400,
       {{161, 0, 8.0, 34},
        {66, 120, 3.7, 49},
        {58, -40, 9.2, 44},
        {0, 56, 3.0, 32},
        {145, 0, 0, std::nullopt}}},
      {5.0,
       0.047,
       5700,
       {{21, 0, 5.1, 26}, {0, 33, 9.6, 26}, {15, -141, 5.6, 26}, {67, 0, 0, std::nullopt}}},
      {6.1,
       0.03,
       5800,
       {{64, 0, 2.3, 19},
        {21, 94, 3.5, 19},
        {63, 114, 4.3, 19},
        {0, -38, 5.9, 19},
        {39, 155, 9.7, 19},
        {52, 0, 0, std::nullopt}}}};
  for (const Case& of : cases) {
    hal::Tube tube;
    tube.pipe_radius_mm = of.pipe_radius_mm;
    tube.program.rows = of.rows;
    for (const std::uint64_t seed : {1, 2, 3}) {
      SCOPED_TRACE(testing::Message() << of.pipe_radius_mm << ", seed " << seed);
      std::mt19937_64 random(seed);
      const Points points =
          tests::SyntheticCloud(tube, {.points = of.points, .noise_mm = of.noise_mm}, random);
      EXPECT_EQ(FoundIn(points).bend_count(), tube.program.bend_count());
    }
  }
}

// A second tube begins beside the end of the first one, nearer than a clamp would hide: their nodes
// connect, and only a bend that no machine makes tells that they are two.
TEST(Structure, TakesANeighbourOff) {
  for (const double turn_deg : {20.0, 40.0, 60.0}) {
    hal::Tube tube;
    tube.pipe_radius_mm = 7.4;
    tube.program.rows = {{60, 0, 82.7, 18.6}, {50, 134, 30, 22.6}, {60, 0, 0, std::nullopt}};
    const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
    const Eigen::Vector3d end = segments.back().PointAt(60);
    const Eigen::Vector3d ahead = segments.back().tangent;
    const Eigen::Vector3d side = ahead.unitOrthogonal();
    hal::Tube other;
    other.pipe_radius_mm = 7.4;
    other.program.rows = {{70, 0, 0, std::nullopt}};
    const double turn = turn_deg * 3.14159265358979 / 180.0;
    const Eigen::Vector3d along = std::cos(turn) * ahead + std::sin(turn) * side;
    other.X_WT.position_mm = end + 2.6 * 7.4 * (0.5 * ahead + 0.87 * side);
    other.X_WT.orientation.setFromTwoVectors(Eigen::Vector3d::UnitX(), along);
    std::mt19937_64 random(30);
    Points points = tests::SyntheticCloud(tube, {.points = 5000, .noise_mm = 0.09}, random);
    const Points more = tests::SyntheticCloud(other, {.points = 1300, .noise_mm = 0.09}, random);
    points.insert(points.end(), more.begin(), more.end());
    EXPECT_EQ(FoundIn(points).bend_count(), 2U) << turn_deg;
  }
}

TEST(StructureWindow, PartsFitInWhereTheyCameFrom) {
  std::mt19937_64 random(1);
  const hal::Tube tube = tests::RandomTube({.bends = 6}, random);
  const ArcLineSpline spline = SplineFromTube(tube);
  for (std::size_t first = 0; first <= 6; ++first) {
    for (std::size_t last = first; last <= 6; ++last) {
      const StructureWindow window{first, last};
      const ArcLineSpline part = PartOf(spline, window);
      EXPECT_EQ(part.arcs.size(), last - first);
      const hal::Tube again = TubeFromSpline(WithPart(spline, window, part), tube.pipe_radius_mm);
      ASSERT_EQ(again.program.rows.size(), tube.program.rows.size());
      for (std::size_t i = 0; i < again.program.rows.size(); ++i) {
        EXPECT_NEAR(again.program.rows[i].length_mm, tube.program.rows[i].length_mm, 1e-9);
        EXPECT_NEAR(again.program.rows[i].angle_deg, tube.program.rows[i].angle_deg, 1e-9);
      }
    }
  }
}

TEST(StructureWindow, EveryPointHasItsSegment) {
  std::mt19937_64 random(2);
  const hal::Tube tube = tests::RandomTube({.bends = 4}, random);
  const Points points = tests::SyntheticCloud(tube, {.points = 4000}, random);
  const std::vector<PointBlock> blocks = {{tube.X_WT.position_mm, 1e6, points}};
  const NearestSegments nearest(tube, blocks);
  EXPECT_EQ(nearest.Of({0, 4}, points.size()).point_count(), points.size());
  std::size_t parts = 0;  // the straights alone, then the arcs between them
  for (std::size_t i = 0; i <= 4; ++i) parts += nearest.Of({i, i}, points.size()).point_count();
  EXPECT_LT(parts, points.size());
  EXPECT_NEAR(static_cast<double>(nearest.Of({0, 4}, 1000).point_count()), 1000, 250);
}

// The plane of a bend of nothing is open: the fit leaves it where it is rather than far away.
TEST(SurfaceFit, StaysWhereNothingPulls) {
  hal::Tube tube;
  tube.pipe_radius_mm = 5;
  tube.program.rows = {{60, 0, 40, 15}, {80, 20, 1e-4, 20}, {70, 60, 50, 15}, {60, 0, 0, {}}};
  std::mt19937_64 random(3);
  const Points points = tests::SyntheticCloud(tube, {.points = 6000}, random);
  const std::vector<PointBlock> blocks = {{tube.X_WT.position_mm, 1e6, points}};
  const SurfaceFit fit = FitSurface(tube, blocks, {.reach_mm = 2});
  const SurfaceFit again = FitSurface(fit.tube, blocks, {.reach_mm = 2});
  EXPECT_LE(again.cost_mm2, 1.001 * fit.cost_mm2);
  for (const hal::BendRow& row : again.tube.program.rows) {
    EXPECT_LT(std::abs(row.angle_deg), 60);
    EXPECT_LT(std::abs(row.length_mm), 200);
  }
}

}  // namespace
}  // namespace bendloop::pipeline
