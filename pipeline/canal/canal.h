// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "hal/clock.h"
#include "hal/result.h"
#include "pipeline/canal/canal_fit.h"
#include "pipeline/spine/spine_method.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

struct CanalOptions {
  // About the pipe's radius [mm]; estimated from the samples when empty.
  std::optional<double> pipe_radius_mm;
  SpineMethod spine_method = SpineMethod::kMls;
  // Only the spine is asked for: no lines and arcs, and a constant radius if that explains the
  // samples as well.
  bool freeform = false;
};

// A canal surface next to the points, before it is described.
struct CanalScan {
  CanalFit fit;
  bool varying_radius = true;
  double radius_mm = 0;                 // estimated, the unit of all searches
  std::vector<Eigen::Vector3d> points;  // near the spine, all of them
  std::vector<CanalFoot> feet;          // theirs
  std::vector<double> along_mm;         // where they are along the spine
  double from_mm = 0, to_mm = 0;        // ends of the pipe, as arc lengths of the fitted spine
  std::size_t all_points = 0;
  bool is_closed = false;          // without an end: from_mm is anywhere
  std::vector<SpineSample> spine;  // evenly spaced from end to end
  std::vector<Eigen::Vector3d> tangents;
  std::vector<StageTime> timing;
};

// kBadInput: the points are no pipe of any kind.
hal::Result<CanalScan> FitCanalScan(std::span<const Eigen::Vector3d> points,
                                    const CanalOptions& options, const hal::Clock& clock);

// The measurement of a canal surface: spine with local radius, distances, coverage. As a canal, the
// rows are the lines and arcs that fit best through its spine; tube.pipe_radius_mm is the mean.
// As a free form, rows is empty: a spine that is no sequence of lines and arcs has no lengths,
// rotations and angles, and a bender must not be told any.
Measurement DescribeCanal(const CanalScan& scan, bool freeform, const hal::Clock& clock);

}  // namespace bendloop::pipeline
