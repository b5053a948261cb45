// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numbers>

#include "drivers/simulated_scanner/tube_surface.h"

// What a tube's wall shows where it is cut: an end's ring, an opening's flank, and the bore behind.
namespace bendloop::drivers {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// Neighbouring faces overlap by this, so that no ray slips between them.
constexpr double kWallSeamMm = 1e-9;

// Where a line that starts at `from` leaves a circle around `center`.
std::optional<double> LeavesCircle(const Vector2d& from, const Vector2d& direction,
                                   const Vector2d& center, double radius_mm) {
  const double a = direction.squaredNorm();
  const double b = (from - center).dot(direction);
  const double c = (from - center).squaredNorm() - radius_mm * radius_mm;
  const double root = b * b - a * c;
  if (!(root > 0) || !(a > 0)) return std::nullopt;
  return (std::sqrt(root) - b) / a;
}

// Where it leaves the rectangle about the origin.
std::optional<double> LeavesBox(const Vector2d& from, const Vector2d& direction,
                                const Vector2d& half_mm) {
  double enters = -1e300, leaves = 1e300;
  for (int axis = 0; axis < 2; ++axis) {
    if (direction[axis] == 0) {
      if (std::abs(from[axis]) > half_mm[axis]) return std::nullopt;
      continue;
    }
    const double one = (-half_mm[axis] - from[axis]) / direction[axis];
    const double other = (half_mm[axis] - from[axis]) / direction[axis];
    enters = std::max(enters, std::min(one, other));
    leaves = std::min(leaves, std::max(one, other));
  }
  if (enters > leaves || leaves == 1e300) return std::nullopt;
  return leaves;
}

}  // namespace

bool TubeSurface::IsInWall(const Part& part, const Vector3d& point_mm) const {
  const double from_spine_mm = FromSpineMm(part, point_mm);
  if (from_spine_mm < pipe_radius_mm_ - wall_mm_ - kWallSeamMm) return false;
  if (from_spine_mm > pipe_radius_mm_ - PressedMm(part, point_mm)) return false;
  const Vector3d from_mm = point_mm - part.segment.start_mm;
  if (!part.segment.is_arc()) {
    const double along_mm = from_mm.dot(part.segment.tangent);
    return along_mm >= -kWallSeamMm && along_mm <= part.segment.length_mm + kWallSeamMm;
  }
  const Vector3d from_center_mm = point_mm - part.center_mm;
  double phi =
      std::atan2(from_center_mm.dot(part.segment.tangent), from_center_mm.dot(part.to_start));
  const double seam_rad = kWallSeamMm / part.segment.bend_radius_mm;
  if (phi < -seam_rad) phi += 2 * std::numbers::pi;
  return phi <= part.segment.angle_rad() + seam_rad;
}

std::optional<Hit> TubeSurface::HitRing(const Part& part, const Cut& cut, const Ray& ray) const {
  const Vector3d normal = cut.outward - cut.slope;
  const double towards = ray.direction.dot(normal);
  if (!(towards < 0)) return std::nullopt;
  // Steps of the plane's slope: the waves of a border that is none are far flatter.
  constexpr int kSteps = 40;
  double along_mm = -(ray.origin_mm - cut.point_mm).dot(normal) / towards;
  for (int i = 0; cut.edge.waves > 0 && i < kSteps; ++i) {
    along_mm -= cut.BeyondMm(ray.At(along_mm)) / towards;
  }
  const Vector3d point_mm = ray.At(along_mm);
  if (!(std::abs(cut.BeyondMm(point_mm)) < 1e-6) || !IsInWall(part, point_mm)) return std::nullopt;
  return Hit{along_mm, normal.normalized()};
}

std::optional<Hit> TubeSurface::HitFlank(const Part& part, const Opening& opening,
                                         const Ray& ray) const {
  const auto seen = [&](const Vector3d& vector) {
    return Vector2d(vector.dot(opening.along), vector.dot(opening.across));
  };
  const Vector2d from = seen(ray.origin_mm - opening.middle_mm), direction = seen(ray.direction);
  // What is drilled away is convex, so a ray leaves it where it leaves the last of its pieces.
  std::optional<double> along_mm;
  const auto leaves = [&](const std::optional<double>& at) {
    if (at && (!along_mm || *at > *along_mm)) along_mm = at;
  };
  for (const double side : {-1.0, 1.0}) {
    leaves(LeavesCircle(from, direction, {side * opening.half_line_mm, 0}, opening.half_width_mm));
  }
  leaves(LeavesBox(from, direction, {opening.half_line_mm, opening.half_width_mm}));
  if (!along_mm) return std::nullopt;
  const Vector3d point_mm = ray.At(*along_mm);
  const Vector3d from_spine_mm = point_mm - opening.frame.spine_mm;
  if (from_spine_mm.dot(opening.frame.outward) < 0) return std::nullopt;  // the wall across
  if (!IsInWall(part, point_mm)) return std::nullopt;
  Vector2d out = from + *along_mm * direction;
  out.x() -= std::clamp(out.x(), -opening.half_line_mm, opening.half_line_mm);
  return Hit{*along_mm,
             -(out.x() * opening.along + out.y() * opening.across) / opening.half_width_mm};
}

std::optional<Hit> TubeSurface::HitWall(const Part& part, const Ray& ray, double from_mm,
                                        double to_mm) const {
  std::optional<Hit> nearest;
  const auto consider = [&](const std::optional<Hit>& hit) {
    // Right behind a face there is material, unless another cut or opening took it.
    constexpr double kBehindMm = 1e-5;
    if (!hit || !(hit->along_mm >= from_mm && hit->along_mm < to_mm)) return;
    if (IsAway(part, ray.At(hit->along_mm + kBehindMm))) return;
    nearest = hit;
    to_mm = hit->along_mm;
  };
  if (wall_mm_ < pipe_radius_mm_) {
    auto bore = HitRound(part, {pipe_radius_mm_ - wall_mm_, true}, ray, from_mm, to_mm);
    if (bore) bore->normal = -bore->normal;
    consider(bore);
  }
  for (const Cut& cut : part.cuts) consider(HitRing(part, cut, ray));
  for (const Opening& opening : openings_) consider(HitFlank(part, opening, ray));
  return nearest;
}

}  // namespace bendloop::drivers
