// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

#include "hal/tube_features.h"
#include "pipeline/features/opening_border.h"
#include "pipeline/features/opening_surroundings.h"

namespace bendloop::pipeline {

// How much likelier [log] it is that a cut left an opening empty, beside which samples lie as they
// do, than that no view showed the wall there. Where nobody knows the views they may be any from
// afar, and as many as explain the samples best, either way. `border`, `wall`: in the plane of
// `frame`, these as far as `reach_mm` from its middle.
double LogOddsOfCut(const LookedAtTube& tube, const hal::SurfaceFrame& frame,
                    const OpeningBorder& border, std::span<const Eigen::Vector2d> wall,
                    double reach_mm);

}  // namespace bendloop::pipeline
