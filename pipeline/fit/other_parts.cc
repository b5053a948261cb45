// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/other_parts.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <optional>

#include "hal/spine.h"

namespace bendloop::pipeline {
namespace {

// [mm] From a piece of the spine; beside its ends there is none of it.
std::optional<double> FromSpineMm(const hal::SpineSegment& segment, const Eigen::Vector3d& at_mm) {
  if (!segment.is_arc()) {
    const Eigen::Vector3d from = at_mm - segment.start_mm;
    const double along_mm = from.dot(segment.tangent);
    if (along_mm < 0 || along_mm > segment.length_mm) return std::nullopt;
    return (from - along_mm * segment.tangent).norm();
  }
  const Eigen::Vector3d from = segment.axes().transpose() * (at_mm - segment.center_mm());
  const double angle = std::atan2(from.x(), -from.y());
  if (angle < 0 || angle > segment.angle_rad()) return std::nullopt;
  return std::hypot(from.head<2>().norm() - segment.bend_radius_mm, from.z());
}

}  // namespace

bool IsOfAnotherPart(const PointBlock& block, const EasedSpine& spine, std::size_t own,
                     double pipe_radius_mm) {
  const auto is_beside = [&](const Eigen::Vector3d& at_mm, double near_mm) {
    for (std::size_t k = 0; k < spine.segments.size(); ++k) {
      const std::size_t row = spine.row(k);
      if (row == own || (!spine.is_line(k) && row + 1 == own)) continue;
      const auto from_mm = FromSpineMm(spine.segments[k], at_mm);
      if (from_mm && *from_mm < near_mm) return true;
    }
    return false;
  };
  const double beside_mm = kBesideTube * pipe_radius_mm;
  if (is_beside(block.center_mm, beside_mm)) return true;
  if (!is_beside(block.center_mm, beside_mm + block.half_diagonal_mm)) return false;
  // Of a cube that the other part only cuts the middle may lie well beside it.
  const auto on_it =
      std::count_if(block.points.begin(), block.points.end(),
                    [&](const Eigen::Vector3d& point) { return is_beside(point, beside_mm); });
  return 2 * static_cast<std::size_t>(on_it) > block.points.size();
}

}  // namespace bendloop::pipeline
