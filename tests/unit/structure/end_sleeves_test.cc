// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/end_sleeves.h"

#include <gtest/gtest.h>

namespace bendloop::pipeline {
namespace {

// Nodes along x, 1 mm apart, from 0 on.
SpinePolygon AlongX(int nodes) {
  SpinePolygon polygon(static_cast<std::size_t>(nodes));
  for (int i = 0; i < nodes; ++i) {
    polygon[static_cast<std::size_t>(i)].position_mm = i * Eigen::Vector3d::UnitX();
  }
  return polygon;
}

TEST(EndSleeve, CutsNodesOffAtItsEndOnly) {
  SpinePolygon polygon = AlongX(10);
  ASSERT_TRUE(CutAt({{6.5, 0, 0}, Eigen::Vector3d::UnitX()}, false, polygon));
  ASSERT_EQ(polygon.size(), 7U);
  EXPECT_EQ(polygon.back().position_mm.x(), 6);
  ASSERT_TRUE(CutAt({{1.5, 0, 0}, -Eigen::Vector3d::UnitX()}, true, polygon));
  ASSERT_EQ(polygon.size(), 5U);
  EXPECT_EQ(polygon.front().position_mm.x(), 2);
}

// A tube that is next to all sleeve is left as it is: nothing can be followed along no nodes.
TEST(EndSleeve, LeavesATubeToFollow) {
  for (const double begin_mm : {-1.0, 0.5, 1.5}) {
    SpinePolygon polygon = AlongX(10);
    EXPECT_FALSE(CutAt({{begin_mm, 0, 0}, Eigen::Vector3d::UnitX()}, false, polygon));
    EXPECT_EQ(polygon.size(), 10U);
    EXPECT_FALSE(CutAt({{9 - begin_mm, 0, 0}, -Eigen::Vector3d::UnitX()}, true, polygon));
    EXPECT_EQ(polygon.size(), 10U);
  }
}

}  // namespace
}  // namespace bendloop::pipeline
