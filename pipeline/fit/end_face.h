// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

namespace bendloop::pipeline {

// The face of an end, seen from beyond it: where along the axis.
struct EndFace {
  double at_mm = 0, sigma_mm = 0;
};

// Samples of a face all lie at one place along the axis but for noise, `noise_mm`, so that they
// crowd there; the outermost of them lie 2 or 3 sigma beyond it. `places_mm`: along the axis, of
// all samples about an end that was found at `end_mm` by the outermost ones. None: samples do not
// crowd there, or over more than noise.
std::optional<EndFace> FindEndFace(std::span<const double> places_mm, double end_mm,
                                   double noise_mm);

}  // namespace bendloop::pipeline
