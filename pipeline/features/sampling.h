// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>

namespace bendloop::pipeline {

// What holds of samples near any border of a tube's wall: its ends and its openings.
struct BorderSampling {
  // [sigma] From the surface; points further off are not the tube's.
  double on_surface = 4.0;
  // [sigma] Below the surface: beside a border samples that lie lower may be of the face that the
  // cut left of the wall, others are of it rarely; of the wall itself one in fifteen lies lower.
  double low = 1.5;
  // Of the noise along the normal: how far it displaces a sample along the surface. Rays come in at
  // up to 60 degrees from the normal across the tube, but at less than 30 along it.
  double along = 0.5;
  // [of r_P] The least displacement that is reckoned with: borders have edges of their own.
  double least = 1e-4;

  // 1 sigma by which noise of `sigma_mm` along the normal displaces samples along the surface.
  double SmearMm(double sigma_mm, double pipe_radius_mm) const {
    return std::max(along * sigma_mm, least * pipe_radius_mm);
  }
};
constexpr BorderSampling kSampling;

}  // namespace bendloop::pipeline
