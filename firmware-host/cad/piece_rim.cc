// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/piece_rim.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace bendloop::host {
namespace {

using Eigen::Vector3d;

// Borders lean by no more than this [deg].
constexpr double kMostLeanDeg = 1;
// They go all around, but for what chords leave [turns].
constexpr double kWholeBorder = 0.98, kOneBorder = 1.02;
// Less says nothing against what the file says.
constexpr double kLeastBeyondMm = 1e-6;
// Points of one border, of two faces that share no edge [mm].
constexpr double kSamePointMm = 1e-3;

// A place of a bend's centre line, and what is about it: along, away from the bend's centre, up.
struct BendFrame {
  Vector3d origin, tangent, away, up;

  BendFrame(const TubePiece& bend, double at)
      : origin(bend.PointAt(at)),
        tangent(bend.TangentAt(at)),
        away((origin - bend.origin).normalized()),
        up(bend.axis) {}
  Vector3d Of(const Vector3d& p) const {
    const Vector3d d = p - origin;
    return {d.dot(tangent), d.dot(away), d.dot(up)};
  }
};

// Least squares of along = a + b away + c up, each point by what it stands for around.
class LeaningPlane {
 public:
  void Add(const Vector3d& p, double weight) {
    const Vector3d row(1, p.y(), p.z());
    normal_ += weight * row * row.transpose();
    value_ += weight * p.x() * row;
    around_ += weight;
  }
  double turns() const { return around_ / (2 * std::numbers::pi); }
  Vector3d Solve() const { return normal_.ldlt().solve(value_); }

 private:
  Eigen::Matrix3d normal_ = Eigen::Matrix3d::Zero();
  Vector3d value_ = Vector3d::Zero();
  double around_ = 0;
};

// How far the border near `at` lies beyond it, where it crosses the centre line [mm]; 0: no border
// is there that leans a little.
double BeyondMm(const TubePiece& bend, double at) {
  const double lean = std::tan(kMostLeanDeg * std::numbers::pi / 180);
  const double most_mm = 2 * lean * bend.radius_mm;
  const BendFrame frame(bend, at);
  LeaningPlane plane;
  for (const FaceEdge* edge : bend.edges) {
    std::vector<Vector3d> points;
    for (const Vector3d& p : edge->points) points.push_back(frame.Of(p));
    if (std::any_of(points.begin(), points.end(), [&](const Vector3d& p) {
          return std::abs(p.x()) > most_mm || p.tail<2>().norm() > 2 * bend.radius_mm;
        })) {
      continue;
    }
    for (std::size_t i = 0; i + 1 < points.size(); ++i) {
      const double a = std::atan2(points[i].z(), points[i].y());
      const double b = std::atan2(points[i + 1].z(), points[i + 1].y());
      const double step = std::abs(std::remainder(b - a, 2 * std::numbers::pi));
      plane.Add(points[i], step / 2);
      plane.Add(points[i + 1], step / 2);
    }
  }
  if (plane.turns() < kWholeBorder || plane.turns() > kOneBorder) return 0;
  const Vector3d fit = plane.Solve();
  // What a file gives in numbers stays that.
  if (!fit.allFinite() || std::abs(fit.x()) < kLeastBeyondMm) return 0;
  return fit.tail<2>().norm() < lean ? fit.x() : 0;
}

bool SamePoints(const FaceEdge& a, const FaceEdge& b) {
  if (a.points.size() < 2 || a.points.size() != b.points.size()) return false;
  const auto same = [](const Vector3d& p, const Vector3d& q) {
    return (p - q).norm() < kSamePointMm;
  };
  return std::equal(a.points.begin(), a.points.end(), b.points.begin(), same) ||
         std::equal(a.points.rbegin(), a.points.rend(), b.points.begin(), same);
}

}  // namespace

void EndAtBorders(TubePiece& piece) {
  if (!piece.is_arc || piece.is_ring()) return;
  const double from = piece.from + BeyondMm(piece, piece.from) / piece.bend_radius_mm;
  const double to = piece.to + BeyondMm(piece, piece.to) / piece.bend_radius_mm;
  if (!(from < to)) return;
  piece.from = from;
  piece.to = to;
}

bool EndsSquare(const TubePiece& bend, double at) {
  constexpr std::size_t kAllAround = 64;  // of 72, but for what chords leave
  const double most_mm =
      2 * std::tan(kMostLeanDeg * std::numbers::pi / 180) * bend.radius_mm + kSamePointMm;
  const BendFrame frame(bend, at);
  Around around;
  for (const FaceEdge* edge : bend.edges) {
    if (std::all_of(edge->points.begin(), edge->points.end(),
                    [&](const Vector3d& p) { return std::abs(frame.Of(p).x()) < most_mm; })) {
      AddAround(edge->points, frame.origin, frame.tangent, around);
    }
  }
  return around.count() >= kAllAround;
}

bool ShareBorder(const TubePiece& a, const TubePiece& b) {
  return std::any_of(a.edges.begin(), a.edges.end(), [&](const FaceEdge* e) {
    return std::any_of(b.edges.begin(), b.edges.end(),
                       [&](const FaceEdge* f) { return e->edge == f->edge || SamePoints(*e, *f); });
  });
}

}  // namespace bendloop::host
