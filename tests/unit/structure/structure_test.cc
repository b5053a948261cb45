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
