// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/straight_score.h"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "hal/spine.h"

namespace bendloop::bench {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;
constexpr double kAlong = 5.0 / kDegrees;

double AngleDeg(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) * kDegrees;
}

}  // namespace

StraightScore ScoreStraights(const hal::Tube& truth, std::span<const FoundCylinder> cylinders) {
  StraightScore score;
  // Directions of the straight before; zero: none, or not found.
  Eigen::Vector3d before_true = Eigen::Vector3d::Zero(), before_found = Eigen::Vector3d::Zero();
  for (const auto& segment : hal::SpineSegments(truth.program, truth.X_WT)) {
    if (segment.is_arc() || segment.length_mm <= 0) continue;
    ++score.straights;
    const FoundCylinder* best = nullptr;
    for (const FoundCylinder& cylinder : cylinders) {
      const Eigen::Vector3d off = segment.PointAt(0.5 * segment.length_mm) - cylinder.point_mm;
      if (cylinder.axis.cross(segment.tangent).norm() > std::sin(kAlong)) continue;
      if (off.cross(cylinder.axis).norm() > 0.5 * truth.pipe_radius_mm) continue;
      if (best == nullptr || cylinder.points > best->points) best = &cylinder;
    }
    Eigen::Vector3d found = Eigen::Vector3d::Zero();
    if (best != nullptr) {
      ++score.found;
      score.radius_mm.Add(best->radius_mm - truth.pipe_radius_mm);
      found = best->axis;
      if (found.dot(segment.tangent) < 0) found = -found;
      if (!before_found.isZero()) {
        score.angle_deg.Add(AngleDeg(before_found, found) - AngleDeg(before_true, segment.tangent));
      }
    }
    before_true = segment.tangent;
    before_found = found;
  }
  return score;
}

std::vector<FoundCylinder> StraightsOf(const hal::Tube& tube) {
  std::vector<FoundCylinder> straights;
  for (const auto& segment : hal::SpineSegments(tube.program, tube.X_WT)) {
    if (segment.is_arc() || segment.length_mm <= 0) continue;
    straights.push_back({segment.PointAt(0.5 * segment.length_mm), segment.tangent,
                         tube.pipe_radius_mm, static_cast<std::size_t>(segment.length_mm)});
  }
  return straights;
}

}  // namespace bendloop::bench
