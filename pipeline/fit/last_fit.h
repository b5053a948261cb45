// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "pipeline/fit/bends_with_bows.h"

namespace bendloop::pipeline {

// `solution`, whose bends are decided, once more by what it has shown itself. Bends that ease are
// as alike as those are that the points know (die_spread.h): a prior that is as wide as usual would
// pull the others, or let them go. Of dents more is left out: what a fit has taken in of one on a
// bend makes it look too small, and its slopes another radius of that.
void FitLast(std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
             BowedSolution& solution);

}  // namespace bendloop::pipeline
