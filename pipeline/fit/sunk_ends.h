// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "pipeline/fit/bends_with_bows.h"
#include "pipeline/fit/surface_points.h"

namespace bendloop::pipeline {

// An outer wall that sinks in does so from the ends of its bend on, or already before them, as the
// die leaves it. Where it is sunk there and no number says so, the spine seems to lie further in,
// as that of a bend that eases. Fits `solution` anew without outer walls about the ends of bends
// whose walls are sunk: what eases moves the inner sides, too. Those points left; none: no wall is
// sunk, or none is without these points, and `solution` stays. Whether
// they are sunk wide or narrow is tried, and kept in `options`.
std::optional<OwnedBlocks> LeaveOutSunkEnds(std::span<const PointBlock> blocks,
                                            SurfaceFitOptions& options, BowedSolution& solution);

}  // namespace bendloop::pipeline
