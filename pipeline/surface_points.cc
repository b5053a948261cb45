// SPDX-License-Identifier: Apache-2.0
#include "pipeline/surface_points.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace bendloop::pipeline {
namespace {

// Distance of the point from the segment's spine; the end straights go on when open.
double DistanceFrom(const Eigen::Vector3d& point, const hal::SpineSegment& segment,
                    bool open_before, bool open_after) {
  const Eigen::Vector3d v = point - segment.start_mm;
  const double x = v.dot(segment.tangent);
  if (!segment.is_arc()) {
    const double low = open_before ? x : std::max(x, 0.0);
    return (v - (open_after ? low : std::min(low, segment.length_mm)) * segment.tangent).norm();
  }
  const double radius = segment.bend_radius_mm;
  const double h = v.dot(segment.normal);
  const double y = radius - v.dot(segment.normal.cross(segment.tangent));  // from the centre
  const double angle = segment.angle_rad();
  const double sine = std::sin(angle);
  const double cosine = std::cos(angle);
  // Inside the sector: after the first plane and before the last, or either beyond a half turn.
  const bool after_first = x >= 0;
  const bool before_last = x * cosine - y * sine <= 0;
  const bool inside =
      angle <= std::numbers::pi ? after_first && before_last : after_first || before_last;
  if (inside) {
    const double u = std::sqrt(x * x + y * y) - radius;
    return std::sqrt(u * u + h * h);
  }
  const double to_start = v.squaredNorm();
  const double ex = x - radius * sine;
  const double ey = y - radius * cosine;
  return std::sqrt(std::min(to_start, ex * ex + ey * ey + h * h));
}

double AlongOf(const Eigen::Vector3d& point, const hal::SpineSegment& segment, bool open_before,
               bool open_after) {
  const Eigen::Vector3d v = point - segment.start_mm;
  const double x = v.dot(segment.tangent);
  if (!segment.is_arc()) {
    const double low = open_before ? x : std::max(x, 0.0);
    return open_after ? low : std::min(low, segment.length_mm);
  }
  const double radius = segment.bend_radius_mm;
  const double y = radius - v.dot(segment.normal.cross(segment.tangent));
  const double angle = segment.angle_rad();
  // Outside the arc the nearer of its two ends is meant: cut the turn opposite to its middle.
  const double middle = 0.5 * angle;
  const double phi = middle + std::remainder(std::atan2(x, y) - middle, 2.0 * std::numbers::pi);
  return radius * std::clamp(phi, 0.0, angle);
}

}  // namespace

NearSegment NearestSegment(const Eigen::Vector3d& point,
                           std::span<const hal::SpineSegment> segments,
                           std::span<const std::int32_t> candidates) {
  NearSegment best{-1, std::numeric_limits<double>::infinity()};
  const auto last = static_cast<std::int32_t>(segments.size()) - 1;
  for (const std::int32_t k : candidates) {
    const double distance =
        DistanceFrom(point, segments[static_cast<std::size_t>(k)], k == 0, k == last);
    if (distance < best.distance_mm) best = {k, distance};
  }
  return best;
}

SpineFoot NearestFoot(const Eigen::Vector3d& point, std::span<const hal::SpineSegment> segments,
                      std::span<const std::int32_t> candidates) {
  const NearSegment near = NearestSegment(point, segments, candidates);
  const auto last = static_cast<std::int32_t>(segments.size()) - 1;
  if (near.segment < 0) return {};
  return {near.segment,
          AlongOf(point, segments[static_cast<std::size_t>(near.segment)], near.segment == 0,
                  near.segment == last),
          near.distance_mm};
}

void CandidateSegments(const PointBlock& block, std::span<const hal::SpineSegment> segments,
                       double reach_mm, std::vector<std::int32_t>& out) {
  out.clear();
  const auto last = static_cast<std::int32_t>(segments.size()) - 1;
  const double reach = reach_mm + block.half_diagonal_mm;
  for (std::int32_t k = 0; k <= last; ++k) {
    if (DistanceFrom(block.center_mm, segments[static_cast<std::size_t>(k)], k == 0, k == last) <=
        reach) {
      out.push_back(k);
    }
  }
}

}  // namespace bendloop::pipeline
