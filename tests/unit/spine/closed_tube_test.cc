// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/closed_tube.h"

#include <gtest/gtest.h>

#include "tests/support/pipe_along.h"

namespace bendloop::pipeline {
namespace {

// Nodes all round, opened somewhere.
SpinePolygon RoundThe(const tests::FreeSpine& ring, std::size_t count) {
  SpinePolygon polygon;
  for (std::size_t i = 0; i < count; ++i) {
    const double t = 0.3 + static_cast<double>(i) / static_cast<double>(count);
    SpineNode node;
    node.position_mm = ring.at_mm(t);
    node.tangent = (ring.at_mm(t + 1e-4) - ring.at_mm(t - 1e-4)).normalized();
    polygon.push_back(node);
  }
  return polygon;
}

TEST(ClosedTube, ARingIsALoopAndAHelixIsNone) {
  EXPECT_TRUE(IsLoop(RoundThe(tests::Helix(40, 0, 1), 120), 5));
  EXPECT_FALSE(IsLoop(RoundThe(tests::Helix(40, 11, 1), 120), 5));
  SpinePolygon half = RoundThe(tests::Helix(40, 0, 1), 120);
  half.resize(60);
  EXPECT_FALSE(IsLoop(half, 5));
}

TEST(ClosedTube, ALoopBeginsWhereSamplesAreMissing) {
  tests::Random random(1);
  auto ring = tests::Helix(40, 0, 1);
  SpinePolygon polygon = RoundThe(ring, 120);
  const SpinePolygon before = polygon;
  EXPECT_FALSE(OpenAtGap(tests::PipeAlong(ring, 5, 5000, 0.05, random), 5, polygon));
  EXPECT_EQ(polygon.front().position_mm, before.front().position_mm);
  // A gap of 2.5 mm at 40, 0, 0.
  ring.from = 0.005, ring.to = 0.995;
  ASSERT_TRUE(OpenAtGap(tests::PipeAlong(ring, 5, 5000, 0.05, random), 5, polygon));
  EXPECT_EQ(polygon.size(), before.size());
  EXPECT_NEAR((polygon.front().position_mm - Eigen::Vector3d(40, 0, 0)).norm(), 0, 3);
  EXPECT_NEAR((polygon.back().position_mm - Eigen::Vector3d(40, 0, 0)).norm(), 0, 3);
}

}  // namespace
}  // namespace bendloop::pipeline
