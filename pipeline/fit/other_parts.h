// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "pipeline/fit/surface_points.h"
#include "pipeline/tube/easing.h"

namespace bendloop::pipeline {

// [of r_P] What is further from the spine may be another part of the tube, not yet found.
constexpr double kBesideTube = 1.3;

// Whether the block's middle, or most of its points, lie on a part of the tube other than the
// straight of row `own` and the bend beside that.
bool IsOfAnotherPart(const PointBlock& block, const EasedSpine& spine, std::size_t own,
                     double pipe_radius_mm);

}  // namespace bendloop::pipeline
