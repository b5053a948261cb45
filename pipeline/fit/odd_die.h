// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "pipeline/fit/bends_with_bows.h"

namespace bendloop::pipeline {

// A slight bend whose radius samples hardly tell is taken to be of the die of the others
// (usual_bend_radius.h), which holds it there however samples pull: what is expected of radii fades
// out only far away, and of bends that ease the easing gives way. Where samples do pull, or the
// easing is unlike the others', the tube is fitted with nothing expected of that bend's radius,
// too. `solution` becomes what is likelier; `doubts` gets what it may be as well.
void TryOddDie(std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
               std::vector<Doubt>& doubts, BowedSolution& solution);

}  // namespace bendloop::pipeline
