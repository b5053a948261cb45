// SPDX-License-Identifier: Apache-2.0
#include "pipeline/inspection/opening_shape.h"

#include <Eigen/Geometry>
#include <cmath>

#include "hal/angles.h"

namespace bendloop::pipeline {
namespace {

// Of the drill's axis, a mm further out: along the feed direction, and towards growing angles.
Eigen::Vector2d SlopeOf(const hal::WallOpening& opening) {
  return {std::tan(opening.lean_along_deg * hal::kRadiansPerDegree),
          std::tan(opening.lean_around_deg * hal::kRadiansPerDegree)};
}

}  // namespace

std::string_view Name(OpeningKind kind) {
  switch (kind) {
    case OpeningKind::kHole:
      return "hole";
    case OpeningKind::kLeaningHole:
      return "leaning hole";
    case OpeningKind::kSlot:
      return "slot";
  }
  return "unknown";
}

OpeningKind KindOf(const hal::WallOpening& opening) {
  if (!opening.is_hole()) return OpeningKind::kSlot;
  const bool leans = opening.lean_along_deg != 0 || opening.lean_around_deg != 0;
  return leans ? OpeningKind::kLeaningHole : OpeningKind::kHole;
}

OpeningShape ShapeOf(const hal::WallOpening& opening) {
  OpeningShape shape{opening.length_mm, opening.width_mm, opening.axis_deg, 0};
  if (KindOf(opening) != OpeningKind::kLeaningHole) return shape;
  const Eigen::Vector2d slope = SlopeOf(opening);
  shape.length_mm *= std::hypot(1.0, slope.norm());
  // Growing angles are against the sense that axes are counted in.
  shape.axis_deg =
      std::remainder(std::atan2(-slope.y(), slope.x()) * hal::kDegreesPerRadian, 180.0);
  shape.lean_deg = std::atan(slope.norm()) * hal::kDegreesPerRadian;
  return shape;
}

OpeningShape ShapeSigma(const hal::WallOpening& opening, const hal::WallOpening& sigma) {
  OpeningShape of{sigma.length_mm, sigma.width_mm, sigma.axis_deg, 0};
  if (KindOf(opening) != OpeningKind::kLeaningHole) return of;
  const Eigen::Vector2d slope = SlopeOf(opening);
  const double steep = slope.norm(), longer = std::hypot(1.0, steep);
  // What 1 sigma of each lean makes of its slope.
  const Eigen::Vector2d slopes =
      hal::kRadiansPerDegree * Eigen::Vector2d((1 + slope.x() * slope.x()) * sigma.lean_along_deg,
                                               (1 + slope.y() * slope.y()) * sigma.lean_around_deg);
  const double steeper = slope.cwiseProduct(slopes).norm() / steep;
  const double turned =
      std::hypot(slope.x() * slopes.y(), slope.y() * slopes.x()) / (steep * steep);
  of.length_mm = std::hypot(longer * sigma.length_mm, opening.length_mm * steep * steeper / longer);
  of.axis_deg = turned * hal::kDegreesPerRadian;
  of.lean_deg = steeper / (longer * longer) * hal::kDegreesPerRadian;
  return of;
}

double LongerByLeanMm(const hal::WallOpening& hole, const hal::WallOpening& sigma) {
  return hole.width_mm * (std::hypot(1.0, SlopeOf(sigma).norm()) - 1.0);
}

double AngleBetweenDrillsDeg(const hal::WallOpening& one, const hal::WallOpening& other) {
  const Eigen::Vector3d a = SlopeOf(one).homogeneous(), b = SlopeOf(other).homogeneous();
  return std::atan2(a.cross(b).norm(), a.dot(b)) * hal::kDegreesPerRadian;
}

}  // namespace bendloop::pipeline
