// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "hal/tube.h"
#include "pipeline/features/surface_cells.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/tube_ends.h"
#include "pipeline/fit/wall_spine.h"
#include "pipeline/points/kept_lines.h"
#include "pipeline/tube/easing.h"
#include "pipeline/tube/tube_features.h"

namespace bendloop::pipeline {

// Holes and slots through the wall: places where no sample lies, neither on the surface nor above
// it, though they are dense all around, as densely as an opening of one clear border leaves them.
// What the scanner did not reach, what a clamp hides and the gaps between laser lines are no holes.
// `tube`: with all that is on its ends; `wall`: what its wall lies about (WallSpineOf()).
// `sigma_mm`: noise of the points. `places`: where cells of the wall are empty; `blocks`: hold the
// points in the balls about these, at least.
std::vector<OpeningFound> FindOpenings(const hal::Tube& tube, const WallSpine& wall,
                                       const TubeEnds& ends, double sigma_mm,
                                       std::span<const PointBlock> blocks,
                                       std::span<const EmptyPlace> places);
// What a place is looked at with.
std::vector<Ball> BallsAbout(const hal::Tube& tube, std::span<const EmptyPlace> places);

}  // namespace bendloop::pipeline
