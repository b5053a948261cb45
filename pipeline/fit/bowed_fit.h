// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "pipeline/fit/bowed_spine.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/fit/surface_points.h"

namespace bendloop::pipeline {

struct BowedFit {
  BowedTubeState state;  // straights that do not bow: that of the fit
  double noise_mm = 0;   // 1 sigma of a point
  double worth = 1;      // times that samples of a place are worth less than independent ones
  bool is_pulled_aside = false;  // some places so far that it is no noise, as by dents
  bool is_lost = false;  // there are bows, and the steps to them led astray: `state` has none
};

// Straights that bow, together with the lines and arcs of a fit: a bowed straight hands on another
// place and direction to the bend behind it, so that lines and arcs alone meet neither. Where the
// samples insist on bows, or places of the tube disagree by more than the fit believes, `fit`
// becomes the tube whose straights are the best-fit lines of the bowed ones, with the covariance
// that this leaves. `options`: of the final fit. `from`: a solution for most of the points, to
// begin there; none: from the lines and arcs of `fit`.
BowedFit FitBows(std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
                 SurfaceFit& fit, const BowedFit* from = nullptr);

}  // namespace bendloop::pipeline
