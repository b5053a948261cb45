// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/other_parts.h"

#include <Eigen/Core>
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
  for (std::size_t k = 0; k < spine.segments.size(); ++k) {
    const std::size_t row = spine.row(k);
    const bool is_own = row == own || (!spine.is_line(k) && row + 1 == own);
    if (is_own) continue;
    const auto from_mm = FromSpineMm(spine.segments[k], block.center_mm);
    if (from_mm && *from_mm < kBesideTube * pipe_radius_mm) return true;
  }
  return false;
}

}  // namespace bendloop::pipeline
