// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "pipeline/fit/bends_with_bows.h"
#include "pipeline/fit/surface_points.h"

namespace bendloop::pipeline {

// Clamp and pressure die need not be alike. Fits `solution` anew, if its bends ease, with bends
// that may rise otherwise than they fall (Easing::skew), where the points insist on it. After the
// number of bends is known: such bends explain much of what is none.
void TrySkewedEasing(std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
                     BowedSolution& solution);

}  // namespace bendloop::pipeline
