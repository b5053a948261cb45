// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spline/arc_line_spline.h"

#include <gtest/gtest.h>

#include "tests/support/shapes.h"

namespace bendloop::pipeline {
namespace {

using tests::Random;

ArcLineSpline SplineOf(const hal::Tube& tube) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  ArcLineSpline spline;
  spline.start_mm = segments.front().start_mm;
  spline.tangent = segments.front().tangent;
  spline.end_mm = segments.back().PointAt(segments.back().length_mm);
  for (const auto& s : segments) {
    if (!s.is_arc()) continue;
    spline.arcs.push_back({s.start_mm, s.PointAt(s.length_mm), s.tangent, s.TangentAt(s.length_mm),
                           s.normal, s.bend_radius_mm, s.angle_rad()});
  }
  return spline;
}

TEST(ArcLineSpline, TubeComesBackFromItsSpine) {
  Random random(1);
  for (int run = 0; run < 60; ++run) {
    const hal::Tube tube = tests::RandomTube({.bends = run % 7,
                                              .min_straight = run % 2 == 0 ? 3.0 : 0.0,
                                              .max_angle_deg = 250,
                                              .one_bend_radius = false},
                                             random);
    const hal::Tube back = TubeFromSpline(SplineOf(tube), tube.pipe_radius_mm);
    ASSERT_EQ(back.program.rows.size(), tube.program.rows.size());
    EXPECT_EQ(back.pipe_radius_mm, tube.pipe_radius_mm);
    for (std::size_t i = 0; i < tube.program.rows.size(); ++i) {
      const auto& truth = tube.program.rows[i];
      const auto& row = back.program.rows[i];
      EXPECT_NEAR(row.length_mm, truth.length_mm, 1e-9);
      EXPECT_NEAR(std::remainder(row.rotation_deg - truth.rotation_deg, 360.0), 0, 1e-8);
      EXPECT_NEAR(row.angle_deg, truth.angle_deg, 1e-9);
      EXPECT_EQ(row.bend_radius_mm.has_value(), truth.bend_radius_mm.has_value());
      EXPECT_NEAR(row.bend_radius_mm.value_or(0), truth.bend_radius_mm.value_or(0), 1e-9);
    }
    EXPECT_EQ(back.program.rows.front().rotation_deg, 0);
    const auto a = hal::SpineSegments(tube.program, tube.X_WT);
    const auto b = hal::SpineSegments(back.program, back.X_WT);
    for (std::size_t k = 0; k < a.size(); ++k) {
      EXPECT_NEAR((a[k].PointAt(a[k].length_mm) - b[k].PointAt(b[k].length_mm)).norm(), 0, 1e-7);
    }
  }
}

TEST(ArcLineSpline, AStraightIsOneRow) {
  ArcLineSpline spline;
  spline.start_mm = {1, 2, 3};
  spline.end_mm = {1, 2, 53};
  spline.tangent = {0, 0, 1};
  const hal::Tube tube = TubeFromSpline(spline, 4);
  ASSERT_EQ(tube.program.rows.size(), 1U);
  EXPECT_DOUBLE_EQ(tube.program.rows[0].length_mm, 50);
  EXPECT_FALSE(tube.program.rows[0].bend_radius_mm);
  EXPECT_NEAR((tube.X_WT * Eigen::Vector3d(50, 0, 0) - spline.end_mm).norm(), 0, 1e-9);
}

TEST(ArcLineSpline, AnOverlapBecomesAStraightOfNothing) {
  Random random(2);
  ArcLineSpline spline = SplineOf(tests::RandomTube({.bends = 2}, random));
  spline.arcs[1].begin_mm = spline.arcs[0].end_mm - 2.0 * spline.arcs[1].tangent_in;
  spline.end_mm = spline.arcs[1].end_mm - spline.arcs[1].tangent_out;
  const hal::Tube tube = TubeFromSpline(spline, 4);
  EXPECT_EQ(tube.program.rows[1].length_mm, 0);
  EXPECT_EQ(tube.program.rows[2].length_mm, 0);
}

}  // namespace
}  // namespace bendloop::pipeline
