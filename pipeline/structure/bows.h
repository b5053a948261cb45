// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include "pipeline/fit/surface_fit.h"

namespace bendloop::pipeline {

// The slightest bend of the fit that is none, if there is one: below the least angle that a machine
// makes, wider than any die, or explained as well by one straight with the bow that tubes of this
// form have (KinkEvidence). Of those that turn by more than `beyond_deg`.
std::optional<std::size_t> FindBow(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                                   double reach_mm, const FormDeviation& form,
                                   double least_angle_deg, double beyond_deg = 0);

}  // namespace bendloop::pipeline
