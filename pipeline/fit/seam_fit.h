// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>

namespace bendloop::pipeline {

// A sample of the wall: how far off the fitted surface it lies.
struct SeamSample {
  double along_mm = 0, around_rad = 0;  // around: in a frame that does not twist
  double off_mm = 0;
  double weight = 1;  // of the variance of all: how much less its own is
};

// A Gaussian ridge all along a tube.
struct Ridge {
  double around_rad = 0, width_rad = 0, height_mm = 0;  // width: 1 sigma
  double around_sigma_rad = 0, height_sigma_mm = 0;
  double Sigmas() const { return height_sigma_mm > 0 ? height_mm / height_sigma_mm : 0; }
};

// Least squares of the samples about it: one ridge, on a wall that curves evenly beside it and
// otherwise from piece to piece of the tube. `piece_mm`: their length. None: it leads away from
// where it began.
std::optional<Ridge> FitRidge(std::span<const SeamSample> samples, const Ridge& start,
                              double piece_mm, double noise_mm);
// [rad] To both sides of a ridge so wide: the wall that is looked at.
double LookedAtBeside(double width_rad);

}  // namespace bendloop::pipeline
