// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/unrolled_wall.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "pipeline/fit/along_wall.h"

namespace bendloop::pipeline {

Eigen::Vector2d UnrolledWall::PlaceOf(const Eigen::Vector3d& point, const SpineFoot& foot) const {
  const hal::SpineSegment& segment = segments_[static_cast<std::size_t>(foot.segment)];
  const Eigen::Vector3d across = Carried(point - segment.PointAt(foot.along_mm),
                                         segment.TangentAt(foot.along_mm), frame_.tangent);
  return {segment.from_start_mm + foot.along_mm,
          r_mm_ * std::atan2(across.dot(frame_.sideways()), across.dot(frame_.outward))};
}

Eigen::Vector3d UnrolledWall::PointAt(const Eigen::Vector2d& place_mm) const {
  const hal::SpineSegment& segment = segments_[hal::SegmentAt(segments_, place_mm.x())];
  const double on_mm = place_mm.x() - segment.from_start_mm, turn = place_mm.y() / r_mm_;
  const Eigen::Vector3d there =
      std::cos(turn) * frame_.outward + std::sin(turn) * frame_.sideways();
  return segment.PointAt(on_mm) + r_mm_ * Carried(there, frame_.tangent, segment.TangentAt(on_mm));
}

double UnrolledWall::AlongWallMm(const Eigen::Vector2d& place_mm, double frame_mm) const {
  const hal::SpineSegment& segment = segments_[hal::SegmentAt(segments_, place_mm.x())];
  const Eigen::Vector3d tangent = segment.TangentAt(place_mm.x() - segment.from_start_mm);
  const double around = place_mm.y() / r_mm_;
  const Eigen::Vector3d outward =
      std::cos(around) * frame_.outward + std::sin(around) * frame_.sideways();
  return place_mm.x() - frame_mm - ShorterByMm(frame_.tangent, tangent, outward, r_mm_);
}

double UnrolledWall::SpineAtMm(double along_wall_mm, double around_mm, double frame_mm) const {
  // Each leaves a part of the one before: the tube's radius over a bend's, which is less than one
  // of bends that are any.
  constexpr int kSteps = 60;
  const double most_mm = 3.0 * std::abs(along_wall_mm) + r_mm_;
  double at_mm = frame_mm + along_wall_mm;
  for (int i = 0; i < kSteps; ++i) {
    const double off_mm = along_wall_mm - AlongWallMm({at_mm, around_mm}, frame_mm);
    at_mm = std::clamp(at_mm + off_mm, frame_mm - most_mm, frame_mm + most_mm);
    if (std::abs(off_mm) < 1e-9 * r_mm_) break;
  }
  return at_mm;
}

Eigen::Vector3d UnrolledWall::Carried(const Eigen::Vector3d& direction, const Eigen::Vector3d& from,
                                      const Eigen::Vector3d& to) {
  return Eigen::Quaterniond::FromTwoVectors(from, to) * direction;
}

}  // namespace bendloop::pipeline
