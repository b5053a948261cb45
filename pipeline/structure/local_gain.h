// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "pipeline/fit/surface_fit.h"

namespace bendloop::pipeline {

// By how much `better` explains the samples better than `rival`, in variances, where every place of
// the surface counts by what is left there: samples that even the better one leaves aside together,
// as in a dent, say no more than that something is there.
// `variance_mm2`: of a sample, at least; `limit_mm`: a distance costs no more.
double LocalGain(const SurfaceFit& better, const SurfaceFit& rival,
                 std::span<const PointBlock> blocks, double variance_mm2, double limit_mm);

}  // namespace bendloop::pipeline
