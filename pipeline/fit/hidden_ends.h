// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <span>

#include "pipeline/fit/surface_fit.h"
#include "pipeline/fit/surface_points.h"

namespace bendloop::pipeline {

// How much of the first and of the last straight lies beyond the points on it [mm]: what a nut, a
// flange or a flare there hides. The part's length is up to its end, and so is the straight.
std::array<double, 2> HiddenMm(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                               double reach_mm);

}  // namespace bendloop::pipeline
