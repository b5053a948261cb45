// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/kept_ends.h"

#include <algorithm>
#include <optional>

#include "hal/spine.h"

namespace bendloop::pipeline {

EndPlaces EndsOf(const hal::Tube& tube) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  return {segments.front().start_mm, segments.back().PointAt(segments.back().length_mm)};
}

void ReachTo(const EndPlaces& ends, hal::Tube& tube) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const hal::SpineSegment &first = segments.front(), &last = segments.back();
  const auto along_mm = [&tube](const hal::SpineSegment& straight, const Eigen::Vector3d& place) {
    const Eigen::Vector3d from = place - straight.start_mm;
    const double at_mm = from.dot(straight.tangent);
    const bool is_on_line = (from - at_mm * straight.tangent).norm() < tube.pipe_radius_mm;
    return is_on_line ? std::optional<double>(at_mm) : std::nullopt;
  };
  auto& rows = tube.program.rows;
  const double before_mm = std::max(0.0, -along_mm(first, ends.first_mm).value_or(0.0));
  tube.X_WT.position_mm -= before_mm * first.tangent;
  rows.front().length_mm += before_mm;
  const double from_start_mm = rows.size() == 1 ? before_mm : 0.0;
  const double to_last_mm = along_mm(last, ends.last_mm).value_or(0.0);
  rows.back().length_mm = std::max(rows.back().length_mm, from_start_mm + to_last_mm);
}

}  // namespace bendloop::pipeline
