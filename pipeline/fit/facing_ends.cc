// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/facing_ends.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace bendloop::pipeline {
namespace {

struct FacingSettings {
  // [of r_P] So far before an end the other may lie, and so far beyond it, by where nodes stopped.
  double before = 4.0, beyond = 1.0;
  // Cosine between their directions, at least.
  double along = 0.9;
  // Times the next widest gap: the one between them, at least.
  double wider = 2.0;
};
constexpr FacingSettings kFacing;

double BesideMm(const hal::SpineSegment& line, const Eigen::Vector3d& point_mm) {
  return line.tangent.cross(point_mm - line.start_mm).norm();
}

}  // namespace

std::optional<double> ToFacingEndMm(std::span<const hal::SpineSegment> segments, bool at_start,
                                    double pipe_radius_mm) {
  if (segments.size() < 2) return std::nullopt;
  const hal::SpineSegment &first = segments.front(), &last = segments.back();
  if (first.tangent.dot(last.tangent) < kFacing.along) return std::nullopt;
  const Eigen::Vector3d last_mm = last.start_mm + last.length_mm * last.tangent;
  if (BesideMm(first, last_mm) > pipe_radius_mm) return std::nullopt;
  const double to_mm = (at_start ? first : last).tangent.dot(first.start_mm - last_mm);
  if (to_mm < -kFacing.beyond * pipe_radius_mm || to_mm > kFacing.before * pipe_radius_mm) {
    return std::nullopt;
  }
  return to_mm;
}

std::optional<FacingEnds> FacingEnds::Find(std::span<const hal::SpineSegment> segments,
                                           double pipe_radius_mm, double reach_mm,
                                           std::span<const PointBlock> blocks) {
  const auto apart_mm = ToFacingEndMm(segments, true, pipe_radius_mm);
  if (!apart_mm) return std::nullopt;
  const hal::SpineSegment &first = segments.front(), &last = segments.back();
  const double start_mm = first.tangent.dot(first.start_mm);
  const double beyond_mm = kFacing.beyond * pipe_radius_mm;
  const double from_mm = start_mm - std::max(0.0, *apart_mm) - beyond_mm;
  const double to_mm = start_mm + std::max(0.0, -*apart_mm) + beyond_mm;
  std::vector<double> along_mm;
  for (const PointBlock& block : blocks) {
    const double center_mm = first.tangent.dot(block.center_mm);
    if (center_mm < from_mm - block.half_diagonal_mm) continue;
    if (center_mm > to_mm + block.half_diagonal_mm) continue;
    for (const Eigen::Vector3d& point : block.points) {
      const double at_mm = first.tangent.dot(point);
      if (at_mm < from_mm || at_mm > to_mm) continue;
      const auto is_on = [&](const hal::SpineSegment& line) {
        return std::abs(BesideMm(line, point) - pipe_radius_mm) <= reach_mm;
      };
      if (is_on(first) || is_on(last)) along_mm.push_back(at_mm);
    }
  }
  std::sort(along_mm.begin(), along_mm.end());
  std::size_t widest = 0;
  double widest_mm = 0, next_mm = 0;
  for (std::size_t i = 1; i < along_mm.size(); ++i) {
    const double gap_mm = along_mm[i] - along_mm[i - 1];
    if (gap_mm > widest_mm) {
      next_mm = widest_mm, widest_mm = gap_mm, widest = i;
    } else {
      next_mm = std::max(next_mm, gap_mm);
    }
  }
  // Else it may be any of those between laser lines.
  if (!(widest_mm > kFacing.wider * next_mm)) return std::nullopt;
  return FacingEnds(first.tangent, 0.5 * (along_mm[widest] + along_mm[widest - 1]));
}

}  // namespace bendloop::pipeline
