// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "pipeline/points/sample_grid.h"
#include "pipeline/spine/spine_polygon.h"

namespace bendloop::pipeline {

// Follows the longest of the curves through its gaps and beyond its ends where the tube goes on
// with too few samples for nodes of its own, as where a scan grows thin: from place to place a
// piece of arc with the pipe's radius is laid through what is there. An end beyond which no tube
// goes on stays as it is, and a gap that hides the tube a gap. Curves that it was led along are
// taken away.
void FollowThinParts(const SampleGrid& grid, double pipe_radius_mm,
                     std::vector<SpinePolygon>& polygons);

}  // namespace bendloop::pipeline
