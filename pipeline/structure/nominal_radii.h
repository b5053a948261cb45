// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "hal/bend_program.h"
#include "pipeline/fit/surface_fit.h"

namespace bendloop::pipeline {

// Of a slight bend the samples do not tell the radius: it is taken to be of the die of the others.
// Where the tube may be bent from the nominal, and that has another radius there, it is that one,
// over the nominal's of the others as theirs are; the corners stay. Nothing changes where samples
// contradict it. `free_pipe_radius`: as the fit was.
void TakeNominalRadii(const hal::BendProgram& nominal, bool free_pipe_radius, SurfaceFit& fit);

}  // namespace bendloop::pipeline
