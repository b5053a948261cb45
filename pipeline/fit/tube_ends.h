// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

#include "hal/tube.h"
#include "pipeline/fit/bowed_spine.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/math/workers.h"

namespace bendloop::pipeline {

// The axis of the tube where it ends: where its straight bows, not that of the best-fit line.
struct EndAxis {
  Eigen::Vector3d end_mm = Eigen::Vector3d::Zero(), outward = Eigen::Vector3d::UnitX();
};

struct TubeEnds {
  hal::Tube tube;             // with first and last length and the start point set
  double first_sigma_mm = 0;  // 1 sigma of where the tube begins, along the first straight
  double last_sigma_mm = 0;   // and where it ends
  bool first_seen = false;    // samples lie on the first straight
  bool last_seen = false;     // and on the last
  EndAxis first, last;
};

// The border of the samples on the two end straights. Where points stop, the tube stops within half
// of the local spacing between them, be they laser lines or scattered; lone points beyond are
// fliers. `sigma_mm`: noise of the points, which tells those on the surface. `bowed`: the same tube
// where its straights bow, which turns its ends; none: they do not.
TubeEnds FindTubeEnds(const hal::Tube& tube, double sigma_mm, std::span<const PointBlock> blocks,
                      Workers* workers = nullptr, const BowedTubeState* bowed = nullptr);

}  // namespace bendloop::pipeline
