// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "pipeline/features/end_border.h"
#include "pipeline/features/end_lines.h"
#include "pipeline/features/end_plane.h"
#include "pipeline/features/end_sectors.h"
#include "pipeline/features/posterior.h"

namespace bendloop::pipeline {

// What walks share.
struct EndDice {
  WalkDice plane{3}, border{4};
};

// What is asked of all samples about an end.
struct SamplesAboutEnd {
  std::size_t count = 0;
  bool knows_passes = false;                                        // of the scan
  std::function<std::vector<EndSample>(std::size_t stride)> every;  // so many of them
  EndBand band;
  // Where something hides that the wall goes on beyond a plane.
  std::function<EndSectors(const Eigen::Vector3d& plane_mm)> hidden;
};

// The plane of an end, or a border that none is where lines and columns say so.
struct EndPlanes {
  EndPlane plane;
  // The same of a border that is ragged (end_ragged.h), where samples are missing before the plane
  // by more than chance: for what is found beside the end, as a bevel, is no reason.
  std::optional<EndPlane> ragged;
};
// None: too few samples. `samples`: from `window_mm` before the end on; `sigma_mm`: noise across
// the wall.
std::optional<EndPlanes> FitEndPlanes(SamplesAboutEnd samples, double pipe_radius_mm,
                                      double window_mm, double sigma_mm, EndDice& dice);
// The ragged one, if any. `knows_passes`: whether theirs is known.
std::optional<EndPlane> FitEndPlane(std::span<const EndSample> samples, double pipe_radius_mm,
                                    double window_mm, double sigma_mm, bool knows_passes = true);

}  // namespace bendloop::pipeline
