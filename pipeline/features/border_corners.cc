// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/border_corners.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

using Eigen::Vector3d;

struct CornerSettings {
  // [rad] Less is a kink that a smooth curve follows within what points tell.
  double least_turn = 35.0 * std::numbers::pi / 180.0;
  // Part of the turn that is left at half the length: 1 at a corner, 1/2 in a bend.
  double kept_at_half = 0.75;
  // Looked at on each side: this part of the border, and never fewer points than the least.
  double side_part = 1.0 / 24;
  std::size_t least_points = 8, most_points = 200;
  // The turn at half the length is above a bend's by so many of its own sigmas.
  double sure_sigmas = 4;
};
constexpr CornerSettings kCorner;

class Turns {
 public:
  explicit Turns(const OrderedBorder& border) : border_(border) {}

  bool Reaches(std::size_t at, std::size_t side) const {
    return border_.closed || (at >= side && at + side < border_.points_mm.size());
  }

  // The angle between the directions of `side` points before and after point `at`. [rad]
  double At(std::size_t at, std::size_t side) const {
    const Vector3d before = Direction(at, side, false), after = Direction(at, side, true);
    return std::atan2(before.cross(after).norm(), before.dot(after));
  }

  double LengthMm(std::size_t at, std::size_t side) const {
    return (Point(at, static_cast<std::ptrdiff_t>(side)) - Point(at, 0)).norm();
  }

 private:
  const Vector3d& Point(std::size_t at, std::ptrdiff_t offset) const {
    const auto n = static_cast<std::ptrdiff_t>(border_.points_mm.size());
    const std::ptrdiff_t i = ((static_cast<std::ptrdiff_t>(at) + offset) % n + n) % n;
    return border_.points_mm[static_cast<std::size_t>(i)];
  }

  // Slope of a line through the points by their numbers, which any noise across leaves unbiased.
  Vector3d Direction(std::size_t at, std::size_t side, bool after) const {
    Vector3d slope = Vector3d::Zero();
    const double middle = 0.5 * static_cast<double>(side);
    for (std::size_t i = 0; i <= side; ++i) {
      const auto offset =
          static_cast<std::ptrdiff_t>(i) - (after ? 0 : static_cast<std::ptrdiff_t>(side));
      slope += (static_cast<double>(i) - middle) * (Point(at, offset) - Point(at, 0));
    }
    return slope;
  }

  const OrderedBorder& border_;
};

}  // namespace

double BorderNoiseMm(const OrderedBorder& border) {
  const std::vector<Vector3d>& p = border.points_mm;
  if (p.size() < 4) return 0;
  std::vector<double> across_mm;
  for (std::size_t i = 0; i + 3 < p.size(); ++i) {
    const Vector3d along = p[i + 3] - p[i];
    if (along.norm() <= 0) continue;
    // Of two points off the line through those beside them.
    const Vector3d off = p[i + 1] - p[i + 2] + along / 3;
    const Vector3d t = along.normalized();
    across_mm.push_back((off - off.dot(t) * t).norm());
  }
  if (across_mm.empty()) return 0;
  // Its variance in each direction is 1 + 1 + 2/9 of a point's; the median of the length of two
  // normal numbers is 1.1774 sigma.
  return Median(std::move(across_mm)) / (1.1774 * std::sqrt(2.0 + 2.0 / 9));
}

std::vector<std::size_t> FindCorners(const OrderedBorder& border, double noise_mm) {
  const std::size_t n = border.points_mm.size();
  const auto side = std::clamp(static_cast<std::size_t>(kCorner.side_part * static_cast<double>(n)),
                               kCorner.least_points, kCorner.most_points);
  if (n < 4 * side) return {};
  const Turns turns(border);
  std::vector<double> turn(n, 0);
  for (std::size_t i = 0; i < n; ++i) {
    if (!turns.Reaches(i, side)) continue;
    const double whole = turns.At(i, side);
    if (whole < kCorner.least_turn) continue;
    // 1 sigma of the slope of a line through `half` even points, on both sides.
    const std::size_t half = side / 2;
    const double length_mm = std::max(turns.LengthMm(i, half), 1e-12);
    const double sigma = noise_mm * std::sqrt(24.0 / static_cast<double>(half)) / length_mm;
    const double near = turns.At(i, half);
    if (near < kCorner.kept_at_half * whole) continue;
    if (near < 0.5 * whole + kCorner.sure_sigmas * sigma) continue;
    turn[i] = near;
  }
  std::vector<std::size_t> corners;
  for (std::size_t i = 0; i < n; ++i) {
    if (turn[i] <= 0) continue;
    bool is_most = true;
    for (std::size_t k = 1; k <= side; ++k) {
      const std::size_t after = border.closed ? (i + k) % n : std::min(i + k, n - 1);
      const std::size_t before = border.closed ? (i + n - k) % n : i - std::min(i, k);
      is_most = is_most && turn[i] >= turn[after] && (turn[i] > turn[before] || before == i);
    }
    if (is_most) corners.push_back(i);
  }
  return corners;
}

}  // namespace bendloop::pipeline
