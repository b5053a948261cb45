// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "pipeline/fit/fit_priors.h"
#include "pipeline/fit/surface_fit.h"

namespace bendloop::pipeline {

// The radius that most of the well-determined bends share; none: they do not, or it would help none
// of the others.
std::optional<UsualBendRadius> FindUsualBendRadius(const SurfaceFit& fit);

// The tube with the usual radius where the fit allows it: the priors do not pull from afar.
hal::Tube WithUsualRadii(const SurfaceFit& fit, const UsualBendRadius& usual);

}  // namespace bendloop::pipeline
