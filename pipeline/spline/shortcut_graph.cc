// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spline/shortcut_graph.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "pipeline/spline/apollonius.h"

namespace bendloop::pipeline {
namespace {

// Where there is no spline within the tolerance, a wider one is tried. By trial.
struct ShortcutSettings {
  double wider = 1.5;  // times the tolerance before
  int tolerances = 6;  // at most, the first included: up to 7.6 times
  // [rad] An arc turns by more, and by less than a full turn without it; 0.06 degrees are no bend.
  double least_turn_rad = 1e-3;
};
constexpr ShortcutSettings kShortcuts;

bool IsBend(double turn_rad) {
  return turn_rad >= kShortcuts.least_turn_rad &&
         turn_rad <= 2.0 * std::numbers::pi - kShortcuts.least_turn_rad;
}

// The plane of an edge: through l_i, as parallel to l_j as it can be.
struct Plane {
  Eigen::Vector3d origin, ex, ey, normal;
  Eigen::Vector2d To(const Eigen::Vector3d& p) const {
    return {(p - origin).dot(ex), (p - origin).dot(ey)};
  }
  double Height(const Eigen::Vector3d& p) const { return (p - origin).dot(normal); }
  Eigen::Vector3d From(const Eigen::Vector2d& p) const { return origin + p.x() * ex + p.y() * ey; }
  Eigen::Vector3d Vector(const Eigen::Vector2d& v) const { return v.x() * ex + v.y() * ey; }
};

std::optional<Plane> PlaneThrough(const TangentLine& line, const Eigen::Vector3d& target) {
  Plane plane;
  plane.origin = line.point_mm;
  plane.ex = line.direction;
  const Eigen::Vector3d v = target - line.point_mm;
  const Eigen::Vector3d across = v - v.dot(plane.ex) * plane.ex;
  if (across.norm() < 1e-9 * (1.0 + v.norm())) return std::nullopt;
  plane.ey = across.normalized();
  plane.normal = plane.ex.cross(plane.ey);
  return plane;
}

// Total signed turn of the polygon's edges i..j in the plane, which tells arcs beyond a half turn
// from their complements.
double TotalTurn(const Plane& plane, std::span<const TangentLine> tangents,
                 const Eigen::Vector2d& first, std::size_t i, std::size_t j) {
  double turn = 0;
  Eigen::Vector2d before = first;
  for (std::size_t k = i + 1; k <= j; ++k) {
    const Eigen::Vector2d now(tangents[k].direction.dot(plane.ex),
                              tangents[k].direction.dot(plane.ey));
    turn += std::atan2(before.x() * now.y() - before.y() * now.x(), before.dot(now));
    before = now;
  }
  return turn;
}

struct Edge {
  SplineArc arc;
  TangentLine modified;  // t'_j, in the plane
  double error2 = 0;
};

struct RadiusError {
  double radius_mm = 0;
  double error2 = 0;  // sum of squared distances [mm^2]
};

// Least squares within the range (section 4.5): a coarse look, then a finer one around the best.
RadiusError ClosestRadius(const TangentCircles& circles, std::span<const Eigen::Vector2d> points,
                          const RadiusRange& valid) {
  const auto error_of = [&](double radius) {
    double sum = 0;
    for (const Eigen::Vector2d& p : points) sum += std::pow(circles.Distance(p, radius), 2);
    return sum;
  };
  const double middle_mm = 0.5 * (valid.low + valid.high);
  RadiusError best{middle_mm, error_of(middle_mm)};
  double span = valid.high - valid.low;
  for (int level = 0; level < 3; ++level) {
    const double middle = level == 0 ? middle_mm : best.radius_mm;
    for (int step = -6; step <= 6; ++step) {
      const double radius = middle + span * step / 12.0;
      if (radius < valid.low || radius > valid.high || radius <= 0) continue;
      const double error = error_of(radius);
      if (error < best.error2) best = {radius, error};
    }
    span /= 6.0;
  }
  return best;
}

// Vertices in the plane of an arc, and how far from them it may pass there.
struct PassedVertices {
  std::vector<Eigen::Vector2d> points;
  std::vector<double> room;  // epsilon'_k
};

// Empty: one of them lies further than epsilon from the plane.
std::optional<PassedVertices> VerticesIn(const Plane& plane,
                                         std::span<const Eigen::Vector3d> vertices,
                                         double epsilon) {
  PassedVertices passed;
  passed.points.reserve(vertices.size());
  passed.room.reserve(vertices.size());
  for (const Eigen::Vector3d& vertex : vertices) {
    const double height = plane.Height(vertex);
    if (std::abs(height) > epsilon) return std::nullopt;
    passed.points.push_back(plane.To(vertex));
    passed.room.push_back(std::sqrt(epsilon * epsilon - height * height));
  }
  return passed;
}

// Radii of the circles that pass all points within their room.
RadiusRange RangeWithin(const TangentCircles& circles, std::span<const Eigen::Vector2d> points,
                        std::span<const double> room) {
  RadiusRange valid{0.0, 1e9};
  for (std::size_t k = 0; k < points.size() && !valid.empty(); ++k) {
    const RadiusRange range = ApolloniusRange(circles, points[k], room[k]);
    valid = {std::max(valid.low, range.low), std::min(valid.high, range.high)};
    if (range.empty()) return range;
  }
  return valid;
}

Edge EdgeWith(const Plane& plane, const TangentCircles& circles, double radius_mm, double turn) {
  Edge edge;
  edge.arc.begin_mm = plane.From(circles.Begin(radius_mm));
  edge.arc.end_mm = plane.From(circles.End(radius_mm));
  edge.arc.normal = turn > 0 ? plane.normal : Eigen::Vector3d(-plane.normal);
  edge.arc.radius_mm = radius_mm;
  edge.arc.angle_rad = std::abs(turn);
  return edge;
}

std::optional<Edge> MakeEdge(std::span<const Eigen::Vector3d> vertices,
                             std::span<const TangentLine> tangents, const TangentLine& first,
                             const Eigen::Vector3d& straight_from, std::size_t i, std::size_t j,
                             double epsilon) {
  // The far vertex of edge j fixes the plane (section 4.1).
  const auto plane = PlaneThrough(first, vertices[j + 1]);
  if (!plane) return std::nullopt;
  const auto passed = VerticesIn(*plane, vertices.subspan(i + 1, j - i), epsilon);
  if (!passed) return std::nullopt;
  const auto& [points, room] = *passed;
  const TangentLine& second = tangents[j];
  if (std::abs(plane->Height(second.point_mm)) > epsilon) return std::nullopt;
  const Eigen::Vector2d projected(second.direction.dot(plane->ex), second.direction.dot(plane->ey));
  if (projected.norm() < 0.5) return std::nullopt;
  const Eigen::Vector2d direction2 = projected.normalized();
  const Eigen::Vector2d point2 = plane->To(second.point_mm);
  const Eigen::Vector2d direction1 = Eigen::Vector2d::UnitX();

  const double total = TotalTurn(*plane, tangents, direction1, i, j);
  double turn = std::atan2(direction2.y(), direction2.x());
  turn += 2.0 * std::numbers::pi * std::round((total - turn) / (2.0 * std::numbers::pi));
  if (!IsBend(std::abs(turn))) return std::nullopt;
  const auto circles =
      MakeTangentCircles(Eigen::Vector2d::Zero(), direction1, point2, direction2, turn);
  if (!circles) return std::nullopt;

  RadiusRange valid = RangeWithin(*circles, points, room);
  if (valid.empty()) return std::nullopt;
  // The first straight starts where the arc before it ended, the second ends at p_{j+1}: the
  // touching points must lie between. Both move linearly with the radius.
  const double start = plane->To(straight_from).x();
  const double reach1 = circles->corner.x() - start;
  const double slope1 = circles->bisector.dot(direction1);
  const double reach2 = (plane->To(vertices[j + 1]) - circles->corner).dot(direction2);
  const double slope2 = circles->bisector.dot(direction2);
  const auto limit = [&valid](double reach, double slope) {  // reach + R slope >= 0
    if (slope < 0) valid.high = std::min(valid.high, reach / -slope);
    if (slope > 0) valid.low = std::max(valid.low, -reach / slope);
  };
  limit(reach1 + 0.5 * epsilon, slope1);
  limit(reach2 + 0.5 * epsilon, -slope2);
  if (valid.empty() || valid.high <= 0) return std::nullopt;

  // The corner of a turn beyond a half lies behind: its reaches may be negative.
  valid.high = std::min(valid.high, valid.low + 1e4 * (1.0 + std::abs(reach1) + std::abs(reach2)));
  const auto [best_radius, best] = ClosestRadius(*circles, points, valid);
  if (!(best_radius > 0)) return std::nullopt;

  Edge edge = EdgeWith(*plane, *circles, best_radius, turn);
  edge.error2 = best;
  edge.arc.tangent_in = first.direction;
  edge.modified = {plane->From(point2), plane->Vector(direction2)};
  edge.arc.tangent_out = edge.modified.direction;
  for (std::size_t k = i + 1; k <= j; ++k) {
    edge.error2 += std::pow(plane->Height(vertices[k]), 2);
  }
  return edge;
}

// The best way to a tangent line.
struct State {
  int arcs = std::numeric_limits<int>::max();
  double error2 = 0;
  std::size_t previous = 0;
  TangentLine line;
  SplineArc arc;
};

std::vector<State> BestWays(std::span<const Eigen::Vector3d> vertices,
                            std::span<const TangentLine> tangents, double epsilon_mm) {
  const std::size_t m = tangents.size();
  std::vector<State> states(m);
  states[0].arcs = 0;
  states[0].line = tangents[0];
  for (std::size_t i = 0; i + 1 < m; ++i) {
    if (states[i].arcs == std::numeric_limits<int>::max()) continue;
    for (std::size_t j = i + 1; j < m; ++j) {
      const int arcs = states[i].arcs + 1;
      if (arcs > states[j].arcs) continue;
      const Eigen::Vector3d& from = i == 0 ? vertices.front() : states[i].arc.end_mm;
      const auto edge = MakeEdge(vertices, tangents, states[i].line, from, i, j, epsilon_mm);
      if (!edge) continue;
      const double error2 = states[i].error2 + edge->error2;
      if (arcs < states[j].arcs || error2 < states[j].error2) {
        states[j] = {arcs, error2, i, edge->modified, edge->arc};
      }
    }
  }
  return states;
}

}  // namespace

ArcLineSpline ApproximateByArcLineSpline(std::span<const Eigen::Vector3d> vertices,
                                         std::span<const TangentLine> tangents, double epsilon_mm) {
  const std::size_t m = tangents.size();
  std::vector<State> states;
  double tolerance_mm = epsilon_mm;
  for (int i = 0; i < kShortcuts.tolerances; ++i, tolerance_mm *= kShortcuts.wider) {
    states = BestWays(vertices, tangents, tolerance_mm);
    if (states.back().arcs < std::numeric_limits<int>::max()) break;
  }

  ArcLineSpline spline;
  spline.start_mm = vertices.front();
  spline.tangent = tangents.front().direction;
  spline.end_mm = vertices.back();
  // The last reachable edge: normally the last of all.
  std::size_t at = m - 1;
  while (at > 0 && states[at].arcs == std::numeric_limits<int>::max()) --at;
  for (; at > 0; at = states[at].previous) spline.arcs.push_back(states[at].arc);
  std::reverse(spline.arcs.begin(), spline.arcs.end());
  return spline;
}

}  // namespace bendloop::pipeline
