// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "hal/tube.h"
#include "pipeline/fit/bow_shapes.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/tube/easing.h"
#include "pipeline/tube/flattening.h"

namespace bendloop::pipeline {

// A tube whose straights bow: each begins as what is before it ends, bows from there, and all that
// is behind it goes on from where it ends.
struct BowedTubeState {
  hal::Tube tube;
  std::vector<Flattening> flattening;
  Easing easing;
  std::vector<Bow> bows;  // by segment
};

// Its spine; each straight is its best-fit line.
EasedSpine SpineOf(const BowedTubeState& state);

// Of its frame: the motion of a straight from where it begins to its best-fit line, by its modes.
BowMotion ToBestFitLine(const Bow& bow, double length_mm);

// What the best-fit line of a straight is of: all but its ends, which belong to the bends, and what
// these ease over. `spine`: as if no straight bowed.
StraightMiddle MiddleOf(const BowedTubeState& state, const EasedSpine& spine, std::size_t segment);

// Lets the first and last straight begin and end where points do, as far as these lie near them.
void EndWithPoints(std::span<const PointBlock> blocks, double reach_mm, BowedTubeState& state);

}  // namespace bendloop::pipeline
