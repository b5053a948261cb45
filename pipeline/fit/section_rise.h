// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "pipeline/fit/bends_with_bows.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/fit/surface_points.h"

namespace bendloop::pipeline {

// Bends whose section is not round before they begin, nor all it will be where they do, as a
// mandrel leaves them (SectionRise). Taken for a section that follows the curvature, that looks
// like easing, and radii become too small and lengths too great. The rise is looked for by the cost
// of the fit, is taken unless the points speak against it, and then is an option for all that is
// fitted later.
void TrySectionRise(std::span<const PointBlock> blocks, SurfaceFitOptions& options,
                    BowedSolution& solution);

}  // namespace bendloop::pipeline
