// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "hal/spine.h"

namespace bendloop::pipeline {

// Points near each other, so that they share the question which segments may be theirs.
struct PointBlock {
  Eigen::Vector3d center_mm;
  double half_diagonal_mm = 0;
  std::vector<Eigen::Vector3d> points;
};

// Where a point belongs on a spine.
struct SpineFoot {
  std::int32_t segment = -1;  // -1: none near
  double along_mm = 0;        // on the segment, within [0, length] but for the two end straights
  double distance_mm = 0;     // from the spine
};

struct NearSegment {
  std::int32_t segment = -1;
  double distance_mm = 0;  // from the spine
};

// Nearest segment among `candidates`. The end straights go on beyond their ends.
NearSegment NearestSegment(const Eigen::Vector3d& point,
                           std::span<const hal::SpineSegment> segments,
                           std::span<const std::int32_t> candidates);

// The same, and where on it.
SpineFoot NearestFoot(const Eigen::Vector3d& point, std::span<const hal::SpineSegment> segments,
                      std::span<const std::int32_t> candidates);

// Segments whose spine passes within `reach_mm` of the block's centre plus its half diagonal.
void CandidateSegments(const PointBlock& block, std::span<const hal::SpineSegment> segments,
                       double reach_mm, std::vector<std::int32_t>& out);

}  // namespace bendloop::pipeline
