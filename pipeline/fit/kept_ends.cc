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

namespace {

// Where the ends' places lie along the first straight and the last, from where these begin; none:
// not on them.
struct AlongEnds {
  std::optional<double> first_mm, last_mm;
};
AlongEnds AlongOf(const EndPlaces& ends, const hal::Tube& tube) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const auto along_mm = [&tube](const hal::SpineSegment& straight, const Eigen::Vector3d& place) {
    const Eigen::Vector3d from = place - straight.start_mm;
    const double at_mm = from.dot(straight.tangent);
    const bool is_on_line = (from - at_mm * straight.tangent).norm() < tube.pipe_radius_mm;
    return is_on_line ? std::optional<double>(at_mm) : std::nullopt;
  };
  return {along_mm(segments.front(), ends.first_mm), along_mm(segments.back(), ends.last_mm)};
}

// The first straight begins so much earlier.
void Lengthen(double by_mm, hal::Tube& tube) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  tube.X_WT.position_mm -= by_mm * segments.front().tangent;
  tube.program.rows.front().length_mm += by_mm;
}

}  // namespace

void ReachTo(const EndPlaces& ends, hal::Tube& tube) {
  const AlongEnds along = AlongOf(ends, tube);
  auto& rows = tube.program.rows;
  const double before_mm = std::max(0.0, -along.first_mm.value_or(0.0));
  Lengthen(before_mm, tube);
  const double from_start_mm = rows.size() == 1 ? before_mm : 0.0;
  rows.back().length_mm =
      std::max(rows.back().length_mm, from_start_mm + along.last_mm.value_or(0.0));
}

void EndAt(const EndPlaces& ends, hal::Tube& tube) {
  auto& rows = tube.program.rows;
  ReachTo(ends, tube);
  const AlongEnds along = AlongOf(ends, tube);
  if (along.last_mm.value_or(0.0) > 0) rows.back().length_mm = *along.last_mm;
  const double first_mm = along.first_mm.value_or(0.0);
  if (first_mm < rows.front().length_mm) Lengthen(-first_mm, tube);
}

}  // namespace bendloop::pipeline
