// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/report/tube_mesh.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace bendloop::host {
namespace {

constexpr double kPi = std::numbers::pi;

double DistanceFromArc(const hal::SpineSegment& arc, const Eigen::Vector3d& p) {
  const Eigen::Vector3d from_center = p - arc.center_mm();
  const Eigen::Vector3d u = (arc.start_mm - arc.center_mm()) / arc.bend_radius_mm;
  double angle = std::atan2(from_center.dot(arc.tangent), from_center.dot(u));
  if (angle < 0) angle += 2 * kPi;
  if (angle <= arc.angle_rad()) return (p - arc.PointAt(angle * arc.bend_radius_mm)).norm();
  return std::min((p - arc.start_mm).norm(), (p - arc.PointAt(arc.length_mm)).norm());
}

}  // namespace

std::vector<int> RingCounts(const std::vector<std::vector<hal::SpineSegment>>& spines) {
  // Rings every 3 degrees look round, rings every 8 mm show how a deviation runs along a straight;
  // the most bounds the page for very long tubes.
  constexpr double kStepRad = 3 * kPi / 180, kStepMm = 8;
  constexpr int kMost = 150;
  std::vector<int> counts;
  for (const auto& spine : spines) {
    counts.resize(std::max(counts.size(), spine.size()), 1);
    for (std::size_t i = 0; i < spine.size(); ++i) {
      const double steps =
          spine[i].is_arc() ? spine[i].angle_rad() / kStepRad : spine[i].length_mm / kStepMm;
      counts[i] =
          std::max(counts[i],
                   static_cast<int>(std::clamp(std::ceil(steps), 1.0, static_cast<double>(kMost))));
    }
  }
  return counts;
}

TubeMesh MakeTubeMesh(const std::vector<hal::SpineSegment>& spine, double pipe_radius_mm,
                      const std::vector<int>& counts) {
  TubeMesh mesh;
  if (spine.empty()) return mesh;
  Eigen::Vector3d side = spine.front().normal;
  for (std::size_t s = 0; s < spine.size(); ++s) {
    const int steps = counts[s];
    // A segment's last ring is the next one's first.
    for (int i = 0; i <= steps - (s + 1 < spine.size() ? 1 : 0); ++i) {
      const double along = spine[s].length_mm * i / steps;
      const Eigen::Vector3d tangent = spine[s].TangentAt(along);
      // Carried along without turning, so that the mesh does not twist where the bend plane does.
      side = (side - side.dot(tangent) * tangent).normalized();
      const Eigen::Vector3d other = tangent.cross(side);
      const Eigen::Vector3d center = spine[s].PointAt(along);
      mesh.centers.push_back(center);
      mesh.segments.push_back(s);
      for (int k = 0; k < TubeMesh::kSides; ++k) {
        const double turn = 2 * kPi * k / TubeMesh::kSides;
        mesh.vertices.push_back(center +
                                pipe_radius_mm * (std::cos(turn) * side + std::sin(turn) * other));
      }
    }
  }
  return mesh;
}

double DistanceFromSpine(const std::vector<hal::SpineSegment>& spine, const Eigen::Vector3d& p) {
  double nearest = std::numeric_limits<double>::infinity();
  for (std::size_t s = 0; s < spine.size(); ++s) {
    const auto& segment = spine[s];
    if (segment.is_arc()) {
      nearest = std::min(nearest, DistanceFromArc(segment, p));
      continue;
    }
    const double from = s == 0 ? -1e300 : 0, to = s + 1 == spine.size() ? 1e300 : segment.length_mm;
    const double along = std::clamp((p - segment.start_mm).dot(segment.tangent), from, to);
    nearest = std::min(nearest, (p - segment.start_mm - along * segment.tangent).norm());
  }
  return nearest;
}

}  // namespace bendloop::host
