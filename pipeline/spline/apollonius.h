// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>

namespace bendloop::pipeline {

// Circles that touch two directed lines of a plane so that an arc leaves the first and joins the
// second in their directions. The centres lie on one bisector; the radius runs along it.
struct TangentCircles {
  Eigen::Vector2d point1, direction1;  // unit; the arc leaves this line
  Eigen::Vector2d point2, direction2;  // unit; the arc joins this line
  double turn_rad = 0;                 // from direction1 to direction2, in (-2 pi, 2 pi), not 0

  // Derived: center(R) = corner + R * bisector.
  Eigen::Vector2d corner = Eigen::Vector2d::Zero();
  Eigen::Vector2d bisector = Eigen::Vector2d::Zero();

  Eigen::Vector2d Center(double radius) const { return corner + radius * bisector; }
  Eigen::Vector2d Begin(double radius) const;  // touching point on line 1
  Eigen::Vector2d End(double radius) const;    // touching point on line 2
  // Distance of `point` from: line 1 up to Begin, the arc, line 2 from End on.
  double Distance(const Eigen::Vector2d& point, double radius) const;
};

// Nothing if the lines are parallel (no corner) to within 1e-6.
std::optional<TangentCircles> MakeTangentCircles(const Eigen::Vector2d& point1,
                                                 const Eigen::Vector2d& direction1,
                                                 const Eigen::Vector2d& point2,
                                                 const Eigen::Vector2d& direction2,
                                                 double turn_rad);

// Radii for which the line-arc-line passes within `epsilon` of a point.
struct RadiusRange {
  double low = 0;
  double high = 0;
  bool empty() const { return !(low <= high); }
};

// From the Apollonius problem line-line-circle: the circles that touch both lines and the circle of
// radius `epsilon` around `point`; every arc with its centre between the outermost pair of
// solutions passes the point within epsilon. Where the small circle meets a line (one pair of
// solutions) the range begins at the corner. Source: Bauer & Polthier 2009, sections 4.2 and 4.3
// (with the erratum on s, t, u, v).
RadiusRange ApolloniusRange(const TangentCircles& circles, const Eigen::Vector2d& point,
                            double epsilon);

}  // namespace bendloop::pipeline
