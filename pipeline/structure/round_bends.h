// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "pipeline/fit/easing_fit.h"

namespace bendloop::pipeline {

// As long as bends are taken for sharp, those that ease look flattened: an outer wall that sinks in
// does to the spine what easing does. `found`, with `options` of the final fit, whose bends are
// flattened, becomes the easing of round bends where the samples then no longer insist on
// flattening, and `options.flattened` false.
void RoundBendsThatEase(const SurfaceFit& structure, std::span<const PointBlock> blocks,
                        SurfaceFitOptions& options, FoundEasing& found);

}  // namespace bendloop::pipeline
