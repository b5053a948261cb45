// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/flat_end.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <vector>

#include "firmware-host/cad/tube_piece.h"

namespace bendloop::host {
namespace {

using Eigen::Vector2d;

// Edges farther off the axis than so many pipe radii are another part's.
constexpr double kFarthestEdgeRadii = 4;
// A round end is no flat one: it is so much wider, and thinner, than the tube.
constexpr double kWider = 1.05, kThinner = 0.95;

// The ends' edges as seen along the axis.
struct FlatOutline {
  std::vector<Vector2d> points;
  Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();  // of the edges' lengths, about the axis

  void Add(const Vector2d& a, const Vector2d& b) {
    points.push_back(a);
    points.push_back(b);
    const double length = (b - a).norm();
    spread +=
        length / 6 *
        (2 * a * a.transpose() + 2 * b * b.transpose() + a * b.transpose() + b * a.transpose());
  }
  double SpanMm(const Vector2d& way) const {
    double low = INFINITY, high = -INFINITY;
    for (const Vector2d& p : points) {
      low = std::min(low, p.dot(way));
      high = std::max(high, p.dot(way));
    }
    return high - low;
  }
};

}  // namespace

std::optional<FlatEnd> FlatEndOf(const CadBody& body, const EndView& view, double at_mm,
                                 double pipe_radius_mm) {
  const Eigen::Vector3d x = view.outward.unitOrthogonal(), y = view.outward.cross(x);
  const double tolerance = MatchToleranceMm(pipe_radius_mm);
  FlatOutline outline;
  for (const FaceEdge& edge : body.edges) {
    const Reach reach = ReachOf(edge, view);
    if (reach.lowest < at_mm - tolerance || reach.highest > at_mm + tolerance ||
        reach.widest > kFarthestEdgeRadii * pipe_radius_mm) {
      continue;
    }
    const auto flat = [&](const Eigen::Vector3d& p) {
      return Vector2d((p - view.origin).dot(x), (p - view.origin).dot(y));
    };
    for (std::size_t i = 0; i + 1 < edge.points.size(); ++i) {
      outline.Add(flat(edge.points[i]), flat(edge.points[i + 1]));
    }
  }
  if (outline.points.empty()) return std::nullopt;
  const Vector2d way =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(outline.spread).eigenvectors().col(1);
  FlatEnd flat;
  flat.wide_mm = outline.SpanMm(way);
  flat.thick_mm = outline.SpanMm({-way.y(), way.x()});
  flat.way = way.x() * x + way.y() * y;
  const double diameter = 2 * pipe_radius_mm;
  if (flat.wide_mm < kWider * diameter || flat.thick_mm > kThinner * diameter) return std::nullopt;
  return flat;
}

}  // namespace bendloop::host
