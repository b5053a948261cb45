// SPDX-License-Identifier: Apache-2.0
#include "hal/tube_features.h"

#include <Eigen/Geometry>
#include <cmath>

#include "hal/angles.h"

namespace bendloop::hal {

std::size_t SegmentAt(std::span<const SpineSegment> segments, double along_mm) {
  std::size_t at = 0;
  while (at + 1 < segments.size() && along_mm >= segments[at + 1].from_start_mm) ++at;
  return at;
}

Eigen::Vector3d AroundZero(std::span<const SpineSegment> segments, std::size_t segment,
                           std::size_t pieces) {
  const bool is_line = segment % (pieces + 1) == 0;
  // A line's own normal is the next bend's.
  return segments[is_line && segment > 0 ? segment - 1 : segment].normal;
}

SurfaceFrame FrameAt(std::span<const SpineSegment> segments, double along_mm, double around_deg,
                     std::size_t pieces) {
  const std::size_t at = SegmentAt(segments, along_mm);
  const double on_segment_mm = along_mm - segments[at].from_start_mm;
  SurfaceFrame frame;
  frame.spine_mm = segments[at].PointAt(on_segment_mm);
  frame.tangent = segments[at].TangentAt(on_segment_mm).normalized();
  frame.outward = Eigen::AngleAxisd(around_deg * kRadiansPerDegree, frame.tangent) *
                  AroundZero(segments, at, pieces);
  return frame;
}

double AroundDeg(const Eigen::Vector3d& zero, const Eigen::Vector3d& tangent,
                 const Eigen::Vector3d& outward) {
  return std::atan2(outward.dot(tangent.cross(zero)), outward.dot(zero)) / kRadiansPerDegree;
}

}  // namespace bendloop::hal
