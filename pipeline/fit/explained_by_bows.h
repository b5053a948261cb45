// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "hal/tube.h"
#include "pipeline/fit/bowed_spine.h"
#include "pipeline/fit/surface_points.h"

namespace bendloop::pipeline {

// By how much less the mean square of the points' distances is where straights may bow than beside
// `straight`, the tube of their best-fit lines [mm^2]. Those lines pass each other, so that such a
// tube lies beside its points by more than the bows are high.
double ExplainedByBowsMm2(const BowedTubeState& bowed, const hal::Tube& straight,
                          std::span<const PointBlock> blocks, double reach_mm);

}  // namespace bendloop::pipeline
