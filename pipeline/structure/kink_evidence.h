// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>

#include "pipeline/fit/surface_fit.h"

namespace bendloop::pipeline {

// A bow of L / N looks to a comparison of structures like a bend of sqrt(24) / N rad, and no number
// of samples parts them there. Their shapes differ: what follows upon a bend is straight.

// By how much the samples of the two straights beside a slight bend are better explained by it than
// by one straight in its place that is bowed, as straights are: twice the logarithm of the
// likelihoods' ratio. Both may be bowed at either side of the bend. Where the straights are too
// short to tell, infinite: it is another question then. `fit` has the bend. `widest_mm`: of the
// radii that machines make; of a wider one bows beside it are the reason.
double KinkEvidence(const SurfaceFit& fit, std::size_t bend, double widest_mm,
                    std::span<const PointBlock> blocks, double reach_mm, const FormDeviation& form);

}  // namespace bendloop::pipeline
