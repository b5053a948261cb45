// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spline/apollonius.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace bendloop::pipeline {
namespace {

double Cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

Eigen::Vector2d LeftOf(const Eigen::Vector2d& v) { return {-v.y(), v.x()}; }

}  // namespace

std::optional<TangentCircles> MakeTangentCircles(const Eigen::Vector2d& point1,
                                                 const Eigen::Vector2d& direction1,
                                                 const Eigen::Vector2d& point2,
                                                 const Eigen::Vector2d& direction2,
                                                 double turn_rad) {
  const double sine = Cross(direction1, direction2);
  if (std::abs(sine) < 1e-6) return std::nullopt;
  TangentCircles circles{point1,
                         direction1,
                         point2,
                         direction2,
                         turn_rad,
                         Eigen::Vector2d::Zero(),
                         Eigen::Vector2d::Zero()};
  circles.corner = point1 + direction1 * (Cross(point2 - point1, direction2) / sine);
  // The centre stands one radius to the turning side of both directed lines, which gives the
  // bisector by its components along the two normals; arcs beyond a half turn need no other case.
  const double side = turn_rad > 0 ? 1.0 : -1.0;
  const Eigen::Vector2d n1 = LeftOf(direction1);
  const Eigen::Vector2d n2 = LeftOf(direction2);
  const double det = Cross(n1, n2);
  circles.bisector = side * Eigen::Vector2d(n2.y() - n1.y(), n1.x() - n2.x()) / det;
  return circles;
}

Eigen::Vector2d TangentCircles::Begin(double radius) const {
  return corner + direction1 * (radius * bisector.dot(direction1));
}

Eigen::Vector2d TangentCircles::End(double radius) const {
  return corner + direction2 * (radius * bisector.dot(direction2));
}

double TangentCircles::Distance(const Eigen::Vector2d& point, double radius) const {
  double best = std::numeric_limits<double>::infinity();
  const Eigen::Vector2d from_begin = point - Begin(radius);
  const double before = from_begin.dot(direction1);
  if (before <= 0) best = std::min(best, std::abs(Cross(direction1, from_begin)));
  const Eigen::Vector2d from_end = point - End(radius);
  const double after = from_end.dot(direction2);
  if (after >= 0) best = std::min(best, std::abs(Cross(direction2, from_end)));
  const Eigen::Vector2d from_center = point - Center(radius);
  const Eigen::Vector2d start = Begin(radius) - Center(radius);
  double angle = std::atan2(Cross(start, from_center), start.dot(from_center));
  if (turn_rad < 0) angle = -angle;
  if (angle < 0) angle += 2.0 * std::numbers::pi;
  if (angle <= std::abs(turn_rad)) best = std::min(best, std::abs(from_center.norm() - radius));
  // Outside all three: the touching points are the nearest.
  if (!std::isfinite(best)) best = std::min(from_begin.norm(), from_end.norm());
  return best;
}

RadiusRange ApolloniusRange(const TangentCircles& circles, const Eigen::Vector2d& point,
                            double epsilon) {
  // |corner + R w - P| = R +- epsilon with q = P - corner:
  // (|w|^2 - 1) R^2 - 2 (w.q +- epsilon) R + |q|^2 - epsilon^2 = 0.
  const Eigen::Vector2d q = point - circles.corner;
  const double a = circles.bisector.squaredNorm() - 1.0;  // tan^2(turn / 2)
  const double c = q.squaredNorm() - epsilon * epsilon;
  std::array<double, 4> roots;
  roots.fill(std::numeric_limits<double>::infinity());
  std::size_t count = 0;
  for (const double sign : {1.0, -1.0}) {
    const double b = circles.bisector.dot(q) + sign * epsilon;
    const double discriminant = b * b - a * c;
    if (discriminant < 0) continue;
    // Citardauq's form where a is small, as for shallow bends.
    const double root = std::sqrt(discriminant);
    const double stable = b >= 0 ? b + root : b - root;
    for (const double radius : {stable / a, stable != 0 ? c / stable : 0.0}) {
      if (std::isfinite(radius) && radius > 0 && count < roots.size()) roots[count++] = radius;
    }
  }
  std::sort(roots.begin(), roots.end());

  // The roots are the only radii where the distance passes epsilon; the ranges between them are
  // tried from the outside in, because of two valid ones the farther from the corner is meant.
  // Beyond the last root every radius is valid or none; for turns beyond a half, often all are.
  RadiusRange range{1.0, 0.0};
  const auto valid = [&](double radius) {
    return circles.Distance(point, radius) <= epsilon * (1.0 + 1e-9);
  };
  const double last = count == 0 ? 0.0 : roots[count - 1];
  if (valid(count == 0 ? q.norm() + epsilon : 2.0 * last)) range = {last, 1e9};
  for (std::size_t i = count; i-- > 0;) {
    const double low = i == 0 ? 0.0 : roots[i - 1];
    if (!valid(0.5 * (low + roots[i]))) {
      if (!range.empty()) break;
      continue;
    }
    if (range.empty()) range.high = roots[i];
    range.low = low;
  }
  return range;
}

}  // namespace bendloop::pipeline
