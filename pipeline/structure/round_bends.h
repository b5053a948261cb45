// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "pipeline/fit/bends_with_bows.h"
#include "pipeline/fit/easing_fit.h"

namespace bendloop::pipeline {

// As long as bends are taken for sharp, those that ease look flattened: an outer wall that sinks in
// does to the spine what easing does. `found`, with `options` of the final fit, whose bends are
// flattened, becomes the easing of round bends where the samples then no longer insist on
// flattening, and `options.flattened` false.
void RoundBendsThatEase(const SurfaceFit& structure, std::span<const PointBlock> blocks,
                        SurfaceFitOptions& options, FoundEasing& found);

// A dent in a bend looks like an outer wall that sinks in there. Where flattened bends leave more
// than noise of their samples, and round ones that leave out dents are spoken for by all points
// (dent_evidence.h), the bends of `solution` are round; and where the points beside its dents no
// longer insist on flattened ones: what a dent hides of a flattened wall nobody knows.
void RoundDentedBends(std::span<const PointBlock> blocks, SurfaceFitOptions& options,
                      BowedSolution& solution);

// What dents, bows and slight bends that are none explain, bends of no round section need not:
// where they are taken for round and the tube, once it is known, leaves more of its points than
// noise, flattened ones are asked again. `solution` becomes theirs where the samples insist on
// them.
void FlattenRoundBends(std::span<const PointBlock> blocks, SurfaceFitOptions& options,
                       BowedSolution& solution);

}  // namespace bendloop::pipeline
