// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/kept_ends.h"

#include <algorithm>

#include "hal/spine.h"

namespace bendloop::pipeline {

EndPlaces EndsOf(const hal::Tube& tube) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  return {segments.front().start_mm, segments.back().PointAt(segments.back().length_mm)};
}

void ReachTo(const EndPlaces& ends, hal::Tube& tube) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const hal::SpineSegment &first = segments.front(), &last = segments.back();
  auto& rows = tube.program.rows;
  const double before_mm = std::max(0.0, (first.start_mm - ends.first_mm).dot(first.tangent));
  tube.X_WT.position_mm -= before_mm * first.tangent;
  rows.front().length_mm += before_mm;
  const double from_start_mm = rows.size() == 1 ? before_mm : 0.0;
  const double to_last_mm = (ends.last_mm - last.start_mm).dot(last.tangent);
  rows.back().length_mm = std::max(rows.back().length_mm, from_start_mm + to_last_mm);
}

}  // namespace bendloop::pipeline
