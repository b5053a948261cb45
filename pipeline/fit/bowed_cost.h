// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "pipeline/fit/bowed_spine.h"
#include "pipeline/fit/surface_points.h"

namespace bendloop::pipeline {

// The sum of squares of all points' distances, bounded for what is far off [variances of
// `sigma_mm`]. A point beyond `reach_mm` counts as if it lay there: a tube that lost its way has
// few near it.
double CostOf(const BowedTubeState& state, std::span<const PointBlock> blocks, double reach_mm,
              double sigma_mm);

}  // namespace bendloop::pipeline
