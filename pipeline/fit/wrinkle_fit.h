// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

namespace bendloop::pipeline {

// A sample of a bend's wall: how far off the fitted surface it lies.
struct BendSample {
  double along_mm = 0;    // from the bend's start
  double around_rad = 0;  // from its innermost line
  double off_mm = 0;
};

struct Waves {
  double height_mm = 0, sigma_mm = 0;  // from crest to trough, on the innermost line
};

// Waves of one length along a bend's inner side, by least squares beside what is even along it:
// their length is what explains the samples best. `length_mm`: of the bend; `about_mm`: how high
// they may be. None: the bend is too short for them, or has too few samples.
std::optional<Waves> FitWaves(std::span<const BendSample> samples, double length_mm,
                              double pipe_radius_mm, double about_mm, double noise_mm);

}  // namespace bendloop::pipeline
