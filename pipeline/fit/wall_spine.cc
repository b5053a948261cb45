// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/wall_spine.h"

#include <algorithm>

#include "pipeline/fit/kept_ends.h"

namespace bendloop::pipeline {

Eigen::Vector3d WallSpine::BesideMm(std::size_t segment, double along_mm) const {
  if (segment >= bows.size() || bows[segment].is_none()) return Eigen::Vector3d::Zero();
  const hal::SpineSegment& line = spine.segments[segment];
  const Bow& bow = bows[segment];
  return line.axes().rightCols<2>() * bow.Beside(bow.At(along_mm, line.length_mm));
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
