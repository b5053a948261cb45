// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "pipeline/fit/surface_fit.h"
#include "pipeline/structure/structure_window.h"

namespace bendloop::pipeline {

// Parts of the tube whose samples within `reach_mm` of it are explained much worse than the others,
// worst first: with the bend before and after each.
std::vector<StructureWindow> BadlyExplainedParts(const SurfaceFit& fit,
                                                 std::span<const PointBlock> blocks,
                                                 double reach_mm);

}  // namespace bendloop::pipeline
