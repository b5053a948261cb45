// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "pipeline/fit/end_forms.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/tube/easing.h"

namespace bendloop::pipeline {

// Points about an end of the straight of that row, as FindFitting() asks for them.
using BlocksAbout =
    std::function<std::vector<PointBlock>(const PlainEnd&, const EasedSpine&, std::size_t row)>;

// How much of the first and of the last straight lies beyond the points on it [mm]: what a nut, a
// flange or a flare there hides. The part's length is up to its end, and so is the straight.
// `blocks`: points near the tube.
std::array<double, 2> HiddenMm(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                               double reach_mm, const BlocksAbout& about);

}  // namespace bendloop::pipeline
