// SPDX-License-Identifier: Apache-2.0
#include "pipeline/surface_points.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace bendloop::pipeline {
namespace {

// Foot on one segment; `open_before` and `open_after` let the end straights go on.
SpineFoot FootOn(const Eigen::Vector3d& point, const hal::SpineSegment& segment, bool open_before,
                 bool open_after) {
  SpineFoot foot;
  const Eigen::Vector3d v = point - segment.start_mm;
  if (!segment.is_arc()) {
    double along = v.dot(segment.tangent);
    if (!open_before) along = std::max(along, 0.0);
    if (!open_after) along = std::min(along, segment.length_mm);
    foot.along_mm = along;
    foot.distance_mm = (v - along * segment.tangent).norm();
    return foot;
  }
  const double radius = segment.bend_radius_mm;
  const Eigen::Vector3d inward = segment.normal.cross(segment.tangent);
  const double x = v.dot(segment.tangent);
  const double y = radius - v.dot(inward);  // from the centre, opposite to `inward`
  double phi = std::atan2(x, y);
  const double angle = segment.angle_rad();
  // Outside the arc the nearer of its two ends is meant: cut the turn opposite to its middle.
  const double middle = 0.5 * angle;
  phi = middle + std::remainder(phi - middle, 2.0 * std::numbers::pi);
  foot.along_mm = radius * std::clamp(phi, 0.0, angle);
  foot.distance_mm = (point - segment.PointAt(foot.along_mm)).norm();
  return foot;
}

}  // namespace

SpineFoot NearestFoot(const Eigen::Vector3d& point, std::span<const hal::SpineSegment> segments,
                      std::span<const std::int32_t> candidates) {
  SpineFoot best;
  best.distance_mm = std::numeric_limits<double>::infinity();
  const auto last = static_cast<std::int32_t>(segments.size()) - 1;
  for (const std::int32_t k : candidates) {
    SpineFoot foot = FootOn(point, segments[static_cast<std::size_t>(k)], k == 0, k == last);
    if (foot.distance_mm < best.distance_mm) {
      best = foot;
      best.segment = k;
    }
  }
  return best;
}

void CandidateSegments(const PointBlock& block, std::span<const hal::SpineSegment> segments,
                       double reach_mm, std::vector<std::int32_t>& out) {
  out.clear();
  const auto last = static_cast<std::int32_t>(segments.size()) - 1;
  const double reach = reach_mm + block.half_diagonal_mm;
  for (std::int32_t k = 0; k <= last; ++k) {
    const SpineFoot foot =
        FootOn(block.center_mm, segments[static_cast<std::size_t>(k)], k == 0, k == last);
    if (foot.distance_mm <= reach) out.push_back(k);
  }
}

}  // namespace bendloop::pipeline
