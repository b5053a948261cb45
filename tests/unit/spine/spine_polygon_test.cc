// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/spine_polygon.h"

#include <gtest/gtest.h>

#include "pipeline/spine/tube_choice.h"
#include "tests/support/shapes.h"

namespace bendloop::pipeline {
namespace {

using tests::Random;
using tests::Uniform;

constexpr double kRadius = 4;

// Nodes as the projection gives them: in no order, at uneven steps, tangents of either sign.
std::vector<SpineNode> NodesOf(const hal::Tube& tube, Random& random, double gap_from = 0,
                               double gap_to = 0) {
  std::vector<SpineNode> nodes;
  double next = 0;
  for (const auto& s : hal::SpineSegments(tube.program, tube.X_WT)) {
    while (next < s.from_start_mm + s.length_mm) {
      const double along = next - s.from_start_mm;
      const double sign = Uniform(random, -1, 1) > 0 ? 1 : -1;
      if (next < gap_from || next >= gap_to) {
        nodes.push_back(
            {s.PointAt(along) + 0.01 * kRadius * tests::RandomUnit(random),
             (sign * s.TangentAt(along) + 0.02 * tests::RandomUnit(random)).normalized(), 0.05,
             20 + static_cast<std::size_t>(Uniform(random, 0, 30))});
      }
      next += kRadius * Uniform(random, 0.15, 0.4);
    }
  }
  std::shuffle(nodes.begin(), nodes.end(), random);
  return nodes;
}

// Arc length of the spine at the point of it that is nearest to `point`.
double AlongOf(const Eigen::Vector3d& point, const hal::Tube& tube) {
  double best = 1e30, along = 0;
  for (const auto& s : hal::SpineSegments(tube.program, tube.X_WT)) {
    for (double a = 0; a <= s.length_mm; a += 0.1) {
      const double d = (s.PointAt(a) - point).norm();
      if (d < best) {
        best = d;
        along = s.from_start_mm + a;
      }
    }
  }
  return along;
}

// One way along the tube without going back, tangents forward, close together but at gaps.
void ExpectOrdered(const SpinePolygon& polygon, const hal::Tube& tube) {
  ASSERT_GE(polygon.size(), 2U);
  std::vector<double> along;
  for (const SpineNode& node : polygon) along.push_back(AlongOf(node.position_mm, tube));
  if (along.front() > along.back()) std::reverse(along.begin(), along.end());
  EXPECT_TRUE(std::is_sorted(along.begin(), along.end()));
  for (std::size_t i = 0; i + 1 < polygon.size(); ++i) {
    const Eigen::Vector3d edge = polygon[i + 1].position_mm - polygon[i].position_mm;
    EXPECT_GT(edge.dot(polygon[i].tangent), 0);
    EXPECT_GT(edge.dot(polygon[i + 1].tangent), 0);
  }
}

TEST(SpinePolygons, RecoverTheOrder) {
  Random random(1);
  for (int run = 0; run < 15; ++run) {
    const hal::Tube tube = tests::RandomTube(
        {.pipe_radius_mm = kRadius, .bends = run % 7, .max_angle_deg = 200}, random);
    const auto polygons = SpinePolygons(NodesOf(tube, random), kRadius);
    ASSERT_EQ(polygons.size(), 1U) << run;
    ExpectOrdered(polygons[0], tube);
    const double length = hal::SpineLength(tube.program);
    EXPECT_NEAR(LengthOf(polygons[0]), length, 0.02 * length + kRadius) << run;
  }
}

TEST(SpinePolygons, BridgeAClampOnStraightsAndInBends) {
  Random random(2);
  for (int run = 0; run < 40; ++run) {
    const hal::Tube tube =
        tests::RandomTube({.pipe_radius_mm = kRadius, .bends = 1 + run % 5}, random);
    const double length = hal::SpineLength(tube.program);
    // A clamp of three radii anywhere, with enough of the tube on both sides to show.
    const double from = Uniform(random, 3 * kRadius, length - 6 * kRadius);
    const auto polygons = SpinePolygons(NodesOf(tube, random, from, from + 3 * kRadius), kRadius);
    ASSERT_EQ(polygons.size(), 1U) << run << " gap at " << from << " of " << length;
    ExpectOrdered(polygons[0], tube);
  }
}

TEST(SpinePolygons, DoNotBridgeALongGap) {
  Random random(3);
  hal::Tube tube;
  tube.pipe_radius_mm = kRadius;
  tube.program.rows = {{200, 0, 0, std::nullopt}};
  const auto polygons = SpinePolygons(NodesOf(tube, random, 60, 60 + 12 * kRadius), kRadius);
  ASSERT_EQ(polygons.size(), 2U);
  EXPECT_GT(LengthOf(polygons[0]), LengthOf(polygons[1]));  // longest first
}

TEST(SpinePolygons, TwoTubesStayTwo) {
  Random random(4);
  for (int run = 0; run < 10; ++run) {
    hal::Tube a = tests::RandomTube({.pipe_radius_mm = kRadius, .bends = 2}, random);
    hal::Tube b = a;  // beside it, touching nearly
    const auto segments = hal::SpineSegments(a.program, a.X_WT);
    b.X_WT.position_mm += 60 * kRadius * segments.front().normal;
    auto nodes = NodesOf(a, random);
    const auto more = NodesOf(b, random);
    nodes.insert(nodes.end(), more.begin(), more.end());
    EXPECT_EQ(SpinePolygons(nodes, kRadius).size(), 2U) << run;
  }
  hal::Tube straight;
  straight.pipe_radius_mm = kRadius;
  straight.program.rows = {{100, 0, 0, std::nullopt}};
  auto nodes = NodesOf(straight, random);
  straight.X_WT.position_mm.y() = 2.1 * kRadius;  // touching nearly, side by side
  const auto more = NodesOf(straight, random);
  nodes.insert(nodes.end(), more.begin(), more.end());
  const auto polygons = SpinePolygons(nodes, kRadius);
  ASSERT_EQ(polygons.size(), 2U);
  for (const auto& polygon : polygons) {
    const double y = polygon.front().position_mm.y();
    for (const auto& node : polygon) EXPECT_NEAR(node.position_mm.y(), y, kRadius);
  }
}

TEST(SpinePolygons, ScrapsAreDropped) {
  Random random(5);
  const hal::Tube tube = tests::RandomTube({.pipe_radius_mm = kRadius, .bends = 3}, random);
  auto nodes = NodesOf(tube, random);
  // Far off: single nodes, and a piece of one radius.
  for (int i = 0; i < 4; ++i) {
    nodes.push_back({Eigen::Vector3d(5000 + 0.3 * kRadius * i, 0, 0), {1, 0, 0}, 0.05, 20});
    nodes.push_back({Eigen::Vector3d(-5000, 100.0 * i, 0), {1, 0, 0}, 0.05, 20});
  }
  const auto polygons = SpinePolygons(nodes, kRadius);
  ASSERT_EQ(polygons.size(), 1U);
  ExpectOrdered(polygons[0], tube);
}

// Nodes along a line from `start`, a third of a radius apart.
SpinePolygon Line(const Eigen::Vector3d& start, const Eigen::Vector3d& direction, double length_mm,
                  double rms_mm) {
  SpinePolygon line;
  for (double at = 0; at <= length_mm; at += kRadius / 3) {
    line.push_back({start + at * direction.normalized(), direction.normalized(), rms_mm, 50});
  }
  return line;
}

TEST(JoinedOverGaps, PreferTheSmoothPieceBehindTheClampToItsEdge) {
  for (const double gap : {4.0, 5.0, 6.0}) {  // radii
    const SpinePolygon before = Line({0, 0, 0}, {1, 0, 0}, 60, 0.02);
    const SpinePolygon after = Line({60 + gap * kRadius, 0, 0}, {1, 0, 0}, 60, 0.02);
    // The edge begins nearer, and aside.
    const SpinePolygon edge = Line({60 + 2 * kRadius, 1.3 * kRadius, 0}, {1, 1.5, 0}, 30, 0.2);
    const auto pieces = JoinedOverGaps({before, edge, after}, kRadius);
    ASSERT_EQ(pieces.size(), 2U) << gap;
    EXPECT_NEAR(LengthOf(pieces[0]), 120 + gap * kRadius, kRadius) << gap;
    for (const SpineNode& node : pieces[0]) EXPECT_NEAR(node.position_mm.y(), 0, 1e-9);
  }
}

TEST(JoinedOverGaps, LeaveOutALastNodeThatIsDisturbed) {
  SpinePolygon before = Line({0, 0, 0}, {1, 0, 0}, 40, 0.02);
  SpinePolygon after = Line({44, 0, 0}, {1, 0, 0}, 40, 0.02);
  // Aside of the other's end, so that no smooth piece leads from one to the other.
  after.front().position_mm = {40.1, 0.5 * kRadius, 0};
  const auto pieces = JoinedOverGaps({before, after}, kRadius);
  ASSERT_EQ(pieces.size(), 1U);
  EXPECT_EQ(pieces[0].size(), before.size() + after.size() - 1);
}

TEST(ChooseTube, AClampsEdgesAreNoSecondTube) {
  const SpinePolygon tube = Line({0, 0, 0}, {1, 0, 0}, 100, 0.02);
  for (const double length_mm : {70.0, 130.0}) {  // shorter, and even longer
    const SpinePolygon edges = Line({0, 50, 0}, {1, 0, 0}, length_mm, 0.2);
    const SpinePolygon second = Line({0, 50, 0}, {1, 0, 0}, length_mm, 0.03);
    std::vector<double> left_out_mm;
    const auto longest_first = [](SpinePolygon a, SpinePolygon b) {
      return LengthOf(a) < LengthOf(b) ? std::vector{b, a} : std::vector{a, b};
    };
    const auto chosen = ChooseTube(longest_first(tube, edges), kRadius, {}, left_out_mm);
    ASSERT_TRUE(chosen);
    EXPECT_EQ(chosen->front().position_mm.y(), 0) << length_mm;
    EXPECT_EQ(left_out_mm.size(), 1U);  // a person may want to look
    EXPECT_FALSE(ChooseTube(longest_first(tube, second), kRadius, {}, left_out_mm));
    // With a nominal its length decides: the pipe radius may be that of the smooth neighbour.
    const hal::BendProgram nominal{{{length_mm, 0, 0, std::nullopt}}};
    const auto rough = ChooseTube(longest_first(tube, edges), kRadius, nominal, left_out_mm);
    ASSERT_TRUE(rough);
    EXPECT_EQ(rough->front().position_mm.y(), 50) << length_mm;
  }
}

TEST(ChooseTube, TellsOfASmoothPieceHoweverLongTheTube) {
  const SpinePolygon tube = Line({0, 0, 0}, {1, 0, 0}, 2000, 0.02);
  std::vector<double> left_out_mm;
  const auto other = [](double radii, double rms_mm) {
    return Line({0, 500, 0}, {1, 0, 0}, radii * kRadius, rms_mm);
  };
  ASSERT_TRUE(
      ChooseTube({tube, other(7, 0.02), other(7, 0.2), other(3, 0.02)}, kRadius, {}, left_out_mm));
  ASSERT_EQ(left_out_mm.size(), 1U);
  EXPECT_NEAR(left_out_mm[0], 7 * kRadius, kRadius);
}

TEST(SpinePolygons, TakeNothing) {
  EXPECT_TRUE(SpinePolygons({}, kRadius).empty());
  const std::vector<SpineNode> same(20, {{1, 2, 3}, {1, 0, 0}, 0.05, 20});
  EXPECT_TRUE(SpinePolygons(same, kRadius).empty());
  EXPECT_EQ(LengthOf({}), 0);
}

TEST(SpinePolygons, DoNotDependOnTheOrderOfTheNodes) {
  Random random(6);
  const hal::Tube tube = tests::RandomTube({.pipe_radius_mm = kRadius, .bends = 4}, random);
  auto nodes = NodesOf(tube, random);
  for (std::size_t i = 0; i < nodes.size(); ++i) nodes[i].samples = 20 + i;  // no ties
  const double length = LengthOf(SpinePolygons(nodes, kRadius).at(0));
  std::reverse(nodes.begin(), nodes.end());
  EXPECT_NEAR(LengthOf(SpinePolygons(nodes, kRadius).at(0)), length, 1e-9);
}

// Where another part of the tube passes near by, a node may be fitted across both: it ends a piece
// and looks elsewhere.
TEST(SpinePolygons, JoinsPastATurnedNode) {
  for (const double side : {-1.0, 1.0}) {
    std::vector<SpineNode> nodes;
    for (int i = 0; i < 60; ++i) {
      SpineNode node{{0.4 * kRadius * i, 0, 0}, Eigen::Vector3d::UnitX(), 0.05, 40};
      if (i == 30) {
        node.position_mm.y() += 0.3 * side * kRadius;
        node.tangent = Eigen::Vector3d(0.5, 0.87 * side, 0).normalized();
      }
      nodes.push_back(node);
    }
    const auto polygons = SpinePolygons(nodes, kRadius);
    ASSERT_EQ(polygons.size(), 1U);
    EXPECT_NEAR(LengthOf(polygons[0]), 0.4 * kRadius * 59, 0.5 * kRadius);
  }
}

}  // namespace
}  // namespace bendloop::pipeline
