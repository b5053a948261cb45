// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "hal/bend_program.h"
#include "pipeline/fit/surface_fit.h"

namespace bendloop::pipeline {

// The least and the greatest bend radius that a nominal gives; 0: it gives none.
struct NominalRadii {
  double least_mm = 0, most_mm = 0;

  // They differ by no more than 3 %: no bend has another.
  bool AreOfOneDie() const { return most_mm <= 1.03 * least_mm; }
};
NominalRadii NominalRadiiOf(const hal::BendProgram& nominal);

// Of a slight bend the samples do not tell the radius: it is taken to be of the die of the others.
// Where the tube may be bent from the nominal, and that has another radius there, it is that one,
// over the nominal's of the others as theirs are; the corners stay. Nothing changes where samples
// contradict it. `free_pipe_radius`: as the fit was.
void TakeNominalRadii(const hal::BendProgram& nominal, bool free_pipe_radius, SurfaceFit& fit);

}  // namespace bendloop::pipeline
