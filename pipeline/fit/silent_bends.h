// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "pipeline/fit/bowed_spine.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// A tape, a label or a sleeve is around a bend, or a dent in it, and takes its radius with it. Told
// where many points of a bend have no say, as they lie beside the tube by more than noise: the few
// that do lie on it tell its radius, and the lengths beside it, as surely as if they were all. And
// where its outer wall stands out of the round one, which no bender makes.
// `fit`, `state`: of the points, the latter where straights bow.
void SayWhatIsAroundBends(const SurfaceFit& fit, const BowedTubeState& state,
                          std::span<const PointBlock> blocks, double reach_mm,
                          Measurement& measurement);

}  // namespace bendloop::pipeline
