// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spline/shortcut_graph.h"

#include <gtest/gtest.h>

#include "pipeline/spline/arc_line_spline.h"
#include "tests/support/shapes.h"

namespace bendloop::pipeline {
namespace {

using tests::kDegrees;
using tests::Points;
using tests::Random;
using tests::Uniform;

// Vertices on the spine: the ends of the straights, and points of the arcs so far apart that their
// chords leave the arc by half of `epsilon` at most.
Points PolygonOf(const hal::Tube& tube, double epsilon, Random& random) {
  Points vertices;
  for (const auto& s : hal::SpineSegments(tube.program, tube.X_WT)) {
    if (!s.is_arc()) {
      vertices.push_back(s.start_mm);
      if (s.length_mm > 0) vertices.push_back(s.PointAt(s.length_mm));
      continue;
    }
    const double step = 2 * s.bend_radius_mm * std::acos(1 - 0.5 * epsilon / s.bend_radius_mm);
    const int steps = std::max(2, static_cast<int>(std::ceil(s.length_mm / step)));
    for (int i = 1; i < steps; ++i) {
      vertices.push_back(s.PointAt(s.length_mm * (i + Uniform(random, -0.2, 0.2)) / steps));
    }
  }
  return vertices;
}

std::vector<TangentLine> EdgesOf(const Points& vertices) {
  std::vector<TangentLine> lines;
  for (std::size_t e = 0; e + 1 < vertices.size(); ++e) {
    lines.push_back({vertices[e], (vertices[e + 1] - vertices[e]).normalized()});
  }
  return lines;
}

TEST(ShortcutGraph, FindsTheBendsOfAnExactPolygon) {
  Random random(1);
  for (int run = 0; run < 36; ++run) {
    const bool beyond = run % 3 == 0;  // a half turn
    const hal::Tube tube = tests::RandomTube({.bends = 1 + run % 5,
                                              .min_angle_deg = beyond ? 200.0 : 15.0,
                                              .max_angle_deg = beyond ? 250.0 : 150.0,
                                              .one_bend_radius = false},
                                             random);
    const double epsilon = 0.1 * tube.pipe_radius_mm;
    const Points vertices = PolygonOf(tube, epsilon, random);
    const auto spline = ApproximateByArcLineSpline(vertices, EdgesOf(vertices), epsilon);
    const hal::Tube found = TubeFromSpline(spline, tube.pipe_radius_mm);
    ASSERT_EQ(found.program.bend_count(), tube.program.bend_count()) << "run " << run;
    for (std::size_t i = 0; i < tube.program.bend_count(); ++i) {
      const auto& row = found.program.rows[i];
      const auto& truth = tube.program.rows[i];
      EXPECT_NEAR(row.angle_deg, truth.angle_deg, 1e-4) << "run " << run << " bend " << i;
      EXPECT_NEAR(std::remainder(row.rotation_deg - truth.rotation_deg, 360.0), 0, 1e-4)
          << "run " << run << " bend " << i;
      // The radius is searched on a grid; small angles leave it open.
      const double sagitta = *truth.bend_radius_mm *
                             (1 / std::cos(std::min(1.2, 0.5 * truth.angle_deg / kDegrees)) - 1);
      if (sagitta > 4 * epsilon && truth.angle_deg < 150) {
        EXPECT_NEAR(*row.bend_radius_mm / *truth.bend_radius_mm, 1, 0.1)
            << "run " << run << " bend " << i;
      }
    }
  }
}

// Every vertex lies within the tolerance of the spline that is returned.
TEST(ShortcutGraph, PassesEveryVertexOfANoisyPolygon) {
  Random random(2);
  for (int run = 0; run < 30; ++run) {
    const hal::Tube tube = tests::RandomTube({.bends = 1 + run % 4}, random);
    const double epsilon = 0.15 * tube.pipe_radius_mm;
    Points vertices = PolygonOf(tube, 0.5 * epsilon, random);
    for (Eigen::Vector3d& v : vertices) v += 0.1 * epsilon * tests::RandomUnit(random);
    const auto spline = ApproximateByArcLineSpline(vertices, EdgesOf(vertices), epsilon);
    const hal::Tube found = TubeFromSpline(spline, tube.pipe_radius_mm);
    EXPECT_GE(found.program.bend_count(), 1U);
    const auto segments = hal::SpineSegments(found.program, found.X_WT);
    for (const Eigen::Vector3d& v : vertices) {
      EXPECT_LE(tests::NearestOnSpine(v, segments, 0.2).first, epsilon * 1.5) << "run " << run;
    }
  }
}

TEST(ShortcutGraph, AStraightHasNoBend) {
  const Points two{{1, 2, 3}, {4, 6, 3}};
  const auto spline = ApproximateByArcLineSpline(two, EdgesOf(two), 0.1);
  EXPECT_TRUE(spline.arcs.empty());
  EXPECT_EQ(spline.start_mm, two[0]);
  EXPECT_EQ(spline.end_mm, two[1]);
  EXPECT_NEAR((spline.tangent - Eigen::Vector3d(0.6, 0.8, 0)).norm(), 0, 1e-12);
  // Vertices in between that lie on the line make no bend either.
  Points many;
  for (int i = 0; i <= 6; ++i) many.emplace_back(10.0 * i, 5.0 * i, 0);
  EXPECT_TRUE(ApproximateByArcLineSpline(many, EdgesOf(many), 0.1).arcs.empty());
}

}  // namespace
}  // namespace bendloop::pipeline
