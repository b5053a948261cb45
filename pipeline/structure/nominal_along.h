// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "hal/bend_program.h"
#include "hal/tube.h"
#include "pipeline/spine/spine_polygon.h"

namespace bendloop::pipeline {

// The nominal, bent as little as need be so that its spine runs along the nodes: where a fit of it
// to the samples starts. Least squares of the nodes' distances, with what springback and stretch
// may do to a part (DirectionOptions) as prior; from the end that fits better. The first and last
// length stay about as the nodes are long.
hal::Tube NominalAlong(const hal::BendProgram& nominal, double pipe_radius_mm,
                       const SpinePolygon& polygon);

// Whether a tube with these sigmas can be a part bent from the nominal, from either end: its rows
// are off by no more than DirectionOptions expects, and no bend is certainly missing. Its first and
// last length are not looked at: only the ends of the samples say what they are.
bool MayBe(const hal::BendProgram& nominal, const hal::Tube& tube, const hal::BendProgram& sigma);

// The same, whatever the radii of its bends are: bends that ease, and straights that bow beside
// them, look wider or tighter than their die, and only the corners stay where they are.
bool MayBeByCorners(const hal::BendProgram& nominal, const hal::Tube& tube,
                    const hal::BendProgram& sigma);

}  // namespace bendloop::pipeline
