// SPDX-License-Identifier: Apache-2.0
#include "pipeline/tube/spine_distance.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

namespace bendloop::pipeline {
namespace {

using Eigen::Vector3d;

double ToLine(const hal::SpineSegment& line, const Vector3d& point_mm) {
  const double along = line.tangent.dot(point_mm - line.start_mm);
  return (point_mm - line.PointAt(std::clamp(along, 0.0, line.length_mm))).norm();
}

double ToArc(const hal::SpineSegment& arc, const Vector3d& point_mm) {
  const Vector3d center = arc.center_mm();
  const Vector3d from_center = point_mm - center;
  const Vector3d outward = (arc.start_mm - center) / arc.bend_radius_mm;
  const double x = from_center.dot(outward);
  const double y = from_center.dot(arc.tangent);
  double phi = std::atan2(y, x);
  if (phi < 0) phi += 2.0 * std::numbers::pi;
  if (phi <= arc.angle_rad()) {
    return std::hypot(std::hypot(x, y) - arc.bend_radius_mm, from_center.dot(arc.normal));
  }
  return std::min((point_mm - arc.start_mm).norm(), (point_mm - arc.PointAt(arc.length_mm)).norm());
}

}  // namespace

SpineDistance::SpineDistance(std::vector<hal::SpineSegment> segments, double extend_mm) {
  if (segments.empty()) return;
  hal::SpineSegment& first = segments.front();
  first.start_mm -= extend_mm * first.tangent;
  first.length_mm += extend_mm;
  segments.back().length_mm += extend_mm;
  pieces_.reserve(segments.size());
  for (hal::SpineSegment& segment : segments) {
    // Every point of the segment is within half its length of its middle.
    const Vector3d middle = segment.PointAt(0.5 * segment.length_mm);
    const double radius = 0.5 * std::abs(segment.length_mm);
    pieces_.push_back({std::move(segment), middle, radius});
  }
}

double SpineDistance::operator()(const Vector3d& point_mm) const {
  double best = std::numeric_limits<double>::infinity();
  for (const Piece& piece : pieces_) {
    if ((point_mm - piece.ball_center_mm).norm() - piece.ball_radius_mm > best) continue;
    best = std::min(best, piece.segment.is_arc() ? ToArc(piece.segment, point_mm)
                                                 : ToLine(piece.segment, point_mm));
  }
  return best;
}

}  // namespace bendloop::pipeline
