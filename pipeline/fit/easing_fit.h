// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "pipeline/fit/surface_fit.h"

namespace bendloop::pipeline {

// Whether the samples insist on bends that ease in and out: the easing of every bend [mm^2] to
// begin the fit of all points with. None: sharp bends explain them as well. `structure`: the tube
// with its bends; `options`: of the final fit.
Easing FindEasing(const SurfaceFit& structure, std::span<const PointBlock> blocks,
                  SurfaceFitOptions options);

}  // namespace bendloop::pipeline
