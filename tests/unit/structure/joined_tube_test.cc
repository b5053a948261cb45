// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/joined_tube.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "hal/spine.h"
#include "pipeline/spline/arc_line_spline.h"
#include "pipeline/structure/structure_moves.h"

namespace bendloop::pipeline {
namespace {

hal::Tube WithShortStraight() {
  hal::Tube tube;
  tube.pipe_radius_mm = 5;
  tube.program.rows = {{60, 0, 40, 15}, {2, 70, 35, 15}, {50, -40, 30, 15}, {80, 0, 0, {}}};
  tube.X_WT.position_mm = {10, -20, 30};
  return tube;
}

Eigen::Vector3d EndOf(const hal::Tube& tube) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  return segments.back().PointAt(segments.back().length_mm);
}

TEST(JoinedTube, OfASplineThatIsOneIsIt) {
  const hal::Tube tube = WithShortStraight();
  const hal::Tube joined = JoinedTube(SplineFromTube(tube), tube.pipe_radius_mm);
  EXPECT_LT((EndOf(joined) - EndOf(tube)).norm(), 1e-9);
}

// What was fitted by itself from the second bend on begins three degrees beside where the first one
// leads, which two millimetres of straight do not show.
TEST(JoinedTube, GoesOnWherePartsDo) {
  const hal::Tube tube = WithShortStraight();
  ArcLineSpline spline = SplineFromTube(tube);
  SplineArc& arc = spline.arcs[1];
  const double beside_rad = 3.0 / 57.2957795;
  arc.tangent_in = Eigen::AngleAxisd(beside_rad, arc.normal) * arc.tangent_in;
  arc.angle_rad -= beside_rad;
  EXPECT_GT((EndOf(TubeFromSpline(spline, tube.pipe_radius_mm)) - EndOf(tube)).norm(), 5.0);
  const hal::Tube joined = JoinedTube(spline, tube.pipe_radius_mm);
  EXPECT_LT((EndOf(joined) - EndOf(tube)).norm(), 0.5);
  const auto is = hal::SpineSegments(joined.program, joined.X_WT);
  const auto was = hal::SpineSegments(tube.program, tube.X_WT);
  ASSERT_EQ(is.size(), was.size());
  for (std::size_t k = 0; k < is.size(); ++k) {
    EXPECT_LT((is[k].start_mm - was[k].start_mm).norm(), 0.5) << k;
  }
}

}  // namespace
}  // namespace bendloop::pipeline
