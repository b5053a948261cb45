// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "pipeline/fit/surface_fit.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// Wrinkles on the inner sides of bends, where the wall is pressed together: waves along the bend,
// highest on its innermost line, that end on its flanks. Told where points of small pieces of the
// inner side scatter more than such of the outer side. `fit`: most tubes' bends fit as well as
// their straights, and have none.
std::vector<WrinklesFound> FindWrinkles(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                                        double reach_mm);

// The points that do not lie on these inner sides: waves of which a bend has one and a half move
// its radius.
OwnedBlocks WithoutWrinkles(const SurfaceFit& fit, std::span<const WrinklesFound> wrinkles,
                            std::span<const PointBlock> blocks);

// Bends may have been parted or joined since: wrinkles are those of the tube's bend where they lie.
// One with a dent has none: that scatters as much.
void KeepThoseOf(const hal::Tube& tube, std::span<const DentFound> dents,
                 std::vector<WrinklesFound>& wrinkles);

}  // namespace bendloop::pipeline
