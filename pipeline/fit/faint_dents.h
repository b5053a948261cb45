// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "pipeline/fit/bends_with_bows.h"

namespace bendloop::pipeline {

// A dent as wide as the bend that it is in, or beside, is nearly what another radius and another
// place of that bend are: what these leave of it no longer looks like a dent. Where there may be
// some of one left the tube is fitted without its points. It is a dent if that tube shows it
// clearly, and all points, these and the others, speak for it: `solution` becomes that.
void TryFaintDents(std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
                   BowedSolution& solution);

}  // namespace bendloop::pipeline
