// SPDX-License-Identifier: Apache-2.0
#include "hal/spine.h"

#include <gtest/gtest.h>

namespace bendloop::hal {
namespace {

// The checked pair of a CAD system's bend machine report: points (0,0,0) (0,0,1495.39)
// (0,10100,1495.39) (0,10100,3989.39) (5718.30,10136.89,3989.39) at a bend radius of 560 are
// lengths 935.39, 8980, 1374, 5158.42 and rotations 180 and 90.37 (90.37 right-handed about the
// feed in that system's sign; the end point decides ours).
TEST(Spine, EndsWhereTheCadReportSaysThatItEnds) {
  const BendProgram program{{{935.39, 0, 90, 560.0},
                             {8980.0, 180, 90, 560.0},
                             {1374.0, 90.37, 90, 560.0},
                             {5158.42, 0, 0, std::nullopt}}};
  // First straight along +z, first bend towards +y: N = z x y = -x.
  Eigen::Matrix3d R_WT;
  R_WT.col(0) = Eigen::Vector3d::UnitZ();
  R_WT.col(2) = -Eigen::Vector3d::UnitX();
  R_WT.col(1) = R_WT.col(2).cross(R_WT.col(0));
  const auto segments = SpineSegments(program, {Eigen::Vector3d::Zero(), Eigen::Quaterniond(R_WT)});
  ASSERT_EQ(segments.size(), 7u);
  const Eigen::Vector3d end = segments.back().PointAt(segments.back().length_mm);
  EXPECT_NEAR(end.x(), 5718.30, 0.05);
  EXPECT_NEAR(end.y(), 10136.89, 0.5);
  EXPECT_NEAR(end.z(), 3989.39, 0.05);
}

TEST(Spine, IsTangentContinuousThroughArcsBeyondAHalfTurn) {
  const BendProgram program{
      {{10, 0, 250, 20.0}, {0, -75, 200, 30.0}, {5, 120, 10, 15.0}, {7, 0, 0, std::nullopt}}};
  const auto segments = SpineSegments(program, {});
  for (std::size_t i = 1; i < segments.size(); ++i) {
    const SpineSegment& before = segments[i - 1];
    EXPECT_LT((before.PointAt(before.length_mm) - segments[i].start_mm).norm(), 1e-12);
    EXPECT_LT((before.TangentAt(before.length_mm) - segments[i].tangent).norm(), 1e-12);
    EXPECT_NEAR(segments[i].normal.dot(segments[i].tangent), 0, 1e-12);
  }
  EXPECT_NEAR(segments.back().from_start_mm + 7, SpineLength(program), 1e-9);
}

TEST(Spine, WrapsRotationsIntoTheHalfOpenTurn) {
  EXPECT_EQ(WrapRotationDeg(-180), 180);
  EXPECT_EQ(WrapRotationDeg(540), 180);
  EXPECT_EQ(WrapRotationDeg(-190), 170);
}

}  // namespace
}  // namespace bendloop::hal
