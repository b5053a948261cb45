// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "hal/bend_program.h"
#include "pipeline/fit/bends_with_bows.h"

namespace bendloop::pipeline {

// One bend that eases, or few that turn alike, look like sharp ones of a wider radius: the samples
// know the variance of its curvature along the spine and not what is arc and what is easing. The
// nominal knows the die. Where found radii are wider than its own, the tube is fitted with bends of
// these that ease; of the two it is what points and nominal together make likelier, and as
// uncertain as the other is likely.
void TryNominalDie(const hal::BendProgram& nominal, std::span<const PointBlock> blocks,
                   const SurfaceFitOptions& options, BowedSolution& solution);

}  // namespace bendloop::pipeline
