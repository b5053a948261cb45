// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/border_sketch.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace bendloop::pipeline {
namespace {

using Eigen::Vector3d;

// [rad] Smooth stretches start with one piece for so much turning.
constexpr double kTurnOfPiece = 1.6;
constexpr std::size_t kMostFirstPieces = 6;
// Part of a piece's points, on each side of a break, that its place and slope are taken from.
constexpr double kPartOfPiece = 0.12;
// Points beside a corner that may belong to the other side of it.
constexpr std::ptrdiff_t kBesideCorner = 2;

struct Line {
  Vector3d place;
  Vector3d direction;  // unit, along the border
};

class Sketcher {
 public:
  Sketcher(const OrderedBorder& border, const std::vector<std::size_t>& breaks)
      : border_(border),
        breaks_(breaks),
        n_(static_cast<std::ptrdiff_t>(border.points_mm.size())) {}

  RationalBezier Run() const {
    RationalBezier curve;
    curve.closed = border_.closed;
    const std::size_t pieces = breaks_.size(), joints = pieces + (border_.closed ? 0 : 1);
    std::vector<Vector3d> places(joints), from(joints), to(joints);
    for (std::size_t j = 0; j < joints; ++j) {
      curve.corner.push_back(IsCorner(j));
      Join(j, places[j], from[j], to[j]);
    }
    for (std::size_t p = 0; p < pieces; ++p) {
      const std::size_t next = border_.closed ? (p + 1) % pieces : p + 1;
      const double handle_mm = LengthMm(p) / 3;
      RationalCubic piece;
      piece.control_mm = {places[p], places[p] + handle_mm * from[p],
                          places[next] - handle_mm * to[next], places[next]};
      curve.pieces.push_back(piece);
    }
    return curve;
  }

 private:
  bool IsEnd(std::size_t joint) const {
    return !border_.closed && (joint == 0 || joint == breaks_.size());
  }

  bool IsCorner(std::size_t joint) const {
    return IsEnd(joint) ||
           std::binary_search(border_.corners.begin(), border_.corners.end(), breaks_[joint]);
  }

  std::ptrdiff_t At(std::size_t joint) const {
    return joint < breaks_.size() ? static_cast<std::ptrdiff_t>(breaks_[joint]) : n_ - 1;
  }

  // Points from one joint to the next.
  std::ptrdiff_t PointsOf(std::size_t piece) const {
    const std::size_t next = piece + 1;
    if (next < breaks_.size()) return At(next) - At(piece);
    return border_.closed ? At(0) + n_ - At(piece) : n_ - 1 - At(piece);
  }

  double LengthMm(std::size_t piece) const {
    // By few points: noise makes the way from each to the next longer than the border is.
    const std::ptrdiff_t points = PointsOf(piece);
    constexpr std::ptrdiff_t kSteps = 8;
    double length_mm = 0;
    for (std::ptrdiff_t k = 0; k < kSteps; ++k) {
      length_mm +=
          (Point(At(piece) + (k + 1) * points / kSteps) - Point(At(piece) + k * points / kSteps))
              .norm();
    }
    return length_mm;
  }

  const Vector3d& Point(std::ptrdiff_t i) const {
    i = border_.closed ? ((i % n_) + n_) % n_ : std::clamp<std::ptrdiff_t>(i, 0, n_ - 1);
    return border_.points_mm[static_cast<std::size_t>(i)];
  }

  // The line through points low to high by their numbers.
  Line Through(std::ptrdiff_t low, std::ptrdiff_t high) const {
    Vector3d mean = Vector3d::Zero(), slope = Vector3d::Zero();
    for (std::ptrdiff_t i = low; i <= high; ++i) mean += Point(i);
    mean /= static_cast<double>(high - low + 1);
    const double middle = 0.5 * static_cast<double>(low + high);
    for (std::ptrdiff_t i = low; i <= high; ++i) {
      slope += (static_cast<double>(i) - middle) * (Point(i) - mean);
    }
    if (slope.norm() <= 0) slope = Point(high + 1) - Point(low - 1);
    if (slope.norm() <= 0) slope = Vector3d::UnitX();
    return {mean, slope.normalized()};
  }

  static std::ptrdiff_t Reach(std::ptrdiff_t points) {
    return std::max<std::ptrdiff_t>(1, std::lround(kPartOfPiece * static_cast<double>(points)));
  }

  void Join(std::size_t joint, Vector3d& place, Vector3d& from, Vector3d& to) const {
    const std::ptrdiff_t at = At(joint);
    const std::size_t before = joint > 0 ? joint - 1 : breaks_.size() - 1;
    const std::size_t after = joint < breaks_.size() ? joint : breaks_.size() - 1;
    const std::ptrdiff_t back = PointsOf(before), ahead = PointsOf(after);
    if (!IsCorner(joint)) {
      const std::ptrdiff_t reach = std::min(Reach(back), Reach(ahead));
      const Line line = Through(at - reach, at + reach);
      place = line.place;
      from = to = line.direction;
      return;
    }
    const auto skip = [](std::ptrdiff_t points) { return points > 10 ? kBesideCorner : 0; };
    const Line ahead_line = Through(at + skip(ahead), at + skip(ahead) + 2 * Reach(ahead));
    const Line back_line = Through(at - skip(back) - 2 * Reach(back), at - skip(back));
    from = ahead_line.direction;
    to = back_line.direction;
    place = Point(at);
    if (IsEnd(joint)) return;
    // The point nearest to both lines.
    const double c = from.dot(to), s2 = 1 - c * c;
    if (s2 < 1e-3) return;
    const Vector3d off = ahead_line.place - back_line.place;
    const double along_back = (off.dot(to) - c * off.dot(from)) / s2;
    const double along_ahead = (c * off.dot(to) - off.dot(from)) / s2;
    const Vector3d meeting =
        0.5 * (back_line.place + along_back * to + ahead_line.place + along_ahead * from);
    // Bends beside a corner may let the lines meet far away.
    const double near_mm = (Point(at + 2 * kBesideCorner) - Point(at - 2 * kBesideCorner)).norm();
    if ((meeting - place).norm() < near_mm) place = meeting;
  }

  const OrderedBorder& border_;
  const std::vector<std::size_t>& breaks_;
  std::ptrdiff_t n_;
};

// [rad] How much the border turns in all, by its outline of a few dozen points.
double TurningOf(const OrderedBorder& border) {
  const std::size_t n = border.points_mm.size(), nodes = std::min<std::size_t>(n / 2, 32);
  std::vector<Vector3d> outline;
  for (std::size_t k = 0; k < nodes; ++k) {
    Vector3d mean = Vector3d::Zero();
    const std::size_t from = k * n / nodes, to = (k + 1) * n / nodes;
    for (std::size_t i = from; i < to; ++i) {
      mean += border.points_mm[i] / static_cast<double>(to - from);
    }
    outline.push_back(mean);
  }
  double turning = 0;
  for (std::size_t k = 0; k + 2 < outline.size(); ++k) {
    const Vector3d a = outline[k + 1] - outline[k], b = outline[k + 2] - outline[k + 1];
    turning += std::atan2(a.cross(b).norm(), a.dot(b));
  }
  return turning;
}

}  // namespace

RationalBezier SketchBorder(const OrderedBorder& border, const std::vector<std::size_t>& breaks) {
  return Sketcher(border, breaks).Run();
}

std::size_t FirstPieces(const OrderedBorder& border) {
  const std::size_t stretches =
      std::max<std::size_t>(1, border.corners.size() + (border.closed ? 0 : 1));
  // What turns in the corners is no piece's.
  constexpr double kTurnOfCorner = 1.0;
  const double smooth =
      TurningOf(border) - kTurnOfCorner * static_cast<double>(border.corners.size());
  const double turn = std::max(0.0, smooth) / static_cast<double>(stretches);
  const auto pieces = std::clamp<std::size_t>(
      static_cast<std::size_t>(std::ceil(turn / kTurnOfPiece)), 1, kMostFirstPieces);
  // A closed curve of one stretch has two joints at least.
  return border.closed && stretches == 1 ? std::max<std::size_t>(pieces, 3) : pieces;
}

}  // namespace bendloop::pipeline
