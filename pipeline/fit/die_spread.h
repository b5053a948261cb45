// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "pipeline/fit/surface_fit.h"

namespace bendloop::pipeline {

// How far bends of one die differ is expected, and told by those whose radius and easing the points
// know: `fit.priors`, with what is left to expect of the others (root mean square over spreads that
// are as likely as each other beforehand, by their evidence: MacKay, Bayesian interpolation, 1992,
// section 4). `fit`: with its covariance. `free_pipe_radius`: of the fit.
FitPriors LearnDieSpread(const SurfaceFit& fit, bool free_pipe_radius);

// [of r_P] How far outer walls sink in is as alike as the bends of a tube are (FitPriors::sunk).
// Where a dent hides one, or half of the dent is taken for it, the others tell.
double LearnSunk(const SurfaceFit& fit);

}  // namespace bendloop::pipeline
