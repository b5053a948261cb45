// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "pipeline/fit/fit_priors.h"
#include "pipeline/fit/surface_fit.h"

namespace bendloop::pipeline {

// The radius that most of the well-determined bends share; none: they do not, or it would help none
// of the others.
std::optional<UsualBendRadius> FindUsualBendRadius(const SurfaceFit& fit);

// What the fit expected of radii that samples do not tell, but of odd ones: the usual one, or as
// the others are. None: nothing.
std::optional<UsualBendRadius> ExpectedRadius(const SurfaceFit& fit);

// The tube with the usual radius where the fit allows it: the priors do not pull from afar.
hal::Tube WithUsualRadii(const SurfaceFit& fit, const UsualBendRadius& usual);

}  // namespace bendloop::pipeline
