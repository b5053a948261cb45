// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/surface_sums.h"

namespace bendloop::pipeline {

// A batch of a block's points, each in the frame of the nearest of several segments.
class NearestLanes {
 public:
  // At most kBatch points. Distances count from the spine, as if the pipe were round; where the
  // segment is flattened, what it lies further in is added.
  void Find(std::span<const Eigen::Vector3d> points, std::span<const SegmentFrame> frames,
            double pipe_radius_mm, std::span<const std::int32_t> candidates);

  // Index in `candidates` of the nearest segment of point i.
  std::size_t Candidate(std::size_t i) const { return nearest_[i]; }
  const LocalLanes& Local(std::size_t candidate) const { return locals_[candidate]; }

 private:
  PointLanes lanes_;
  std::vector<LocalLanes> locals_;
  std::array<std::size_t, kBatch> nearest_{};
  std::array<double, kBatch> inside_mm_{}, least_mm_{};
};

// Where on an arc the points are, as seen from its centre [mm from its start]: outside the arc at
// the nearer end. Good to a hundred-thousandth of the bend radius.
void AlongArc(const SegmentFrame& frame, const LocalLanes& local, std::size_t count,
              std::array<double, kBatch>& along_mm);

}  // namespace bendloop::pipeline
