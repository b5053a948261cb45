// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "pipeline/fit/bends_with_bows.h"

namespace bendloop::pipeline {

// Of a bend whose points are left out with a dent nobody knows the radius: it stays where the dent
// has led it, from where no prior pulls it back, and the wall that the dent is measured from with
// it. Where the others share one (usual_bend_radius.h) `solution` is fitted once more from that.
void TakeUsualWhereHidden(const SurfaceFitOptions& options, BowedSolution& solution);

}  // namespace bendloop::pipeline
