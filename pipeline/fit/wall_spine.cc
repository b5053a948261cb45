// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/wall_spine.h"

#include <algorithm>
#include <numeric>

#include "pipeline/fit/kept_ends.h"

namespace bendloop::pipeline {

Eigen::Vector3d WallSpine::BesideMm(std::size_t segment, double along_mm) const {
  if (segment >= bows.size() || bows[segment].is_none()) return Eigen::Vector3d::Zero();
  const hal::SpineSegment& line = spine.segments[segment];
  const Bow& bow = bows[segment];
  return line.axes().rightCols<2>() * bow.Beside(bow.At(along_mm, line.length_mm));
}

PlacesOnWall::PlacesOnWall(const WallSpine& wall)
    : wall_(wall), frames_(SegmentFrames(wall.spine, 0.0, {})), all_(wall.spine.segments.size()) {
  std::iota(all_.begin(), all_.end(), 0);
}

SpineFoot PlacesOnWall::FootOf(const Eigen::Vector3d& place_mm) const {
  return NearestFoot(place_mm, wall_.spine.segments, frames_, all_);
}

Eigen::Vector3d PlacesOnWall::Straightened(const Eigen::Vector3d& place_mm,
                                           const SpineFoot& foot) const {
  if (foot.segment < 0) return place_mm;
  return place_mm - wall_.BesideMm(static_cast<std::size_t>(foot.segment), foot.along_mm);
}

std::pair<hal::SurfaceFrame, double> PlacesOnWall::FrameTo(const Eigen::Vector3d& place_mm) const {
  const auto& segments = wall_.spine.segments;
  const Eigen::Vector3d point = Straightened(place_mm, FootOf(place_mm));
  const SpineFoot foot = FootOf(point);
  const double along_mm =
      foot.segment < 0
          ? 0.0
          : segments[static_cast<std::size_t>(foot.segment)].from_start_mm + foot.along_mm;
  hal::SurfaceFrame frame = hal::FrameAt(segments, along_mm, 0.0, wall_.spine.pieces);
  const Eigen::Vector3d out = point - frame.spine_mm;
  frame.outward = (out - out.dot(frame.tangent) * frame.tangent).normalized();
  return {frame, along_mm};
}

WallSpine WallSpineOf(const BowedTubeState& bowed, const hal::Tube& tube, const Easing& easing) {
  if (!bowed.is_bowed() || bowed.tube.program.rows.size() != tube.program.rows.size()) {
    return {SpineOf(tube.program, tube.X_WT, easing)};
  }
  WallSpine wall{SpineOf(bowed), bowed.bows};
  const EndPlaces ends = EndsOf(tube);
  hal::SpineSegment &first = wall.spine.segments.front(), &last = wall.spine.segments.back();
  const double from_mm = (ends.first_mm - first.start_mm).dot(first.tangent);
  first.start_mm += from_mm * first.tangent;
  first.length_mm -= from_mm;
  wall.bows.front().before_mm += from_mm;
  const double to_mm = (ends.last_mm - last.start_mm).dot(last.tangent);
  wall.bows.back().after_mm += last.length_mm - to_mm;
  last.length_mm = to_mm;
  double from_start_mm = 0;
  for (hal::SpineSegment& segment : wall.spine.segments) {
    segment.length_mm = std::max(0.0, segment.length_mm);
    segment.from_start_mm = from_start_mm;
    from_start_mm += segment.length_mm;
  }
  return wall;
}

}  // namespace bendloop::pipeline
