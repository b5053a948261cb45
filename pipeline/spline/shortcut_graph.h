// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

namespace bendloop::pipeline {

// A tangent line of the polygon: straights of the spline lie on such lines.
struct TangentLine {
  Eigen::Vector3d point_mm;
  Eigen::Vector3d direction;  // unit, forward
};

// An arc between two tangent lines.
struct SplineArc {
  Eigen::Vector3d begin_mm, end_mm;         // touching points
  Eigen::Vector3d tangent_in, tangent_out;  // unit
  Eigen::Vector3d normal;                   // unit, t_in x t_out of a turn below pi
  double radius_mm = 0;
  double angle_rad = 0;  // may exceed pi
};

// An arc-line spline: straights between `start`, the arcs and `end`.
struct ArcLineSpline {
  Eigen::Vector3d start_mm, end_mm;
  Eigen::Vector3d tangent;  // unit, at the start
  std::vector<SplineArc> arcs;
};

// Fewest arcs whose arc-line spline on the tangent lines passes within `epsilon_mm` of every vertex
// of the polygon; least sum of squared distances among these.
// `vertices` has m + 1 points, `tangents` one line for each of its m edges (m >= 1).
// Where no spline comes so near the tolerance is widened, up to ten times; after that the spline
// ends at the last line that it reaches. Empty arcs: a straight. Source: Bauer & Polthier 2009,
// sections 4.1 and 4.2, algorithm 1.
ArcLineSpline ApproximateByArcLineSpline(std::span<const Eigen::Vector3d> vertices,
                                         std::span<const TangentLine> tangents, double epsilon_mm);

}  // namespace bendloop::pipeline
