// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "hal/tube.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/math/magnitude_histogram.h"
#include "pipeline/math/workers.h"

namespace bendloop::pipeline {

// How the noise along the surface normal depends on the angle at which the laser meets the surface:
// learnt from the distances and from nothing else, because triangulation grows uncertain at grazing
// incidence by as much as sensor and surface have it, and noise along the ray alone grows less.
class NoiseByIncidence {
 public:
  static constexpr std::size_t kCodes = 256;  // of the cosine of the incidence, 0: not known
  static constexpr std::uint8_t CodeOf(double cosine) {
    return static_cast<std::uint8_t>(1.0 + (cosine < 1.0 ? cosine : 1.0) * (kCodes - 2));
  }

  void Add(std::uint8_t code, double distance_mm) {
    ++counts_[code];
    classes_[code / kCodesOfClass].Add(distance_mm);
  }
  void Add(const NoiseByIncidence& other);

  // By code: standard deviation of a point of mean weight over that of such points. Mean square
  // over all points: 1. None when the noise is alike or not known better than that: monotone with
  // the cosine, it would not make the result better by a percent for certain.
  std::optional<std::array<float, kCodes>> Certainties() const;
  double SigmaMm() const;  // robust standard deviation of all distances

 private:
  static constexpr std::size_t kClasses = 16;
  static constexpr std::size_t kCodesOfClass = kCodes / kClasses;

  std::array<MagnitudeHistogram, kClasses> classes_;
  std::array<std::uint32_t, kCodes> counts_{};
};

// Certainties of points, which blocks look at.
struct IncidenceWeights {
  std::vector<float> certainties;  // empty: the points are alike, or their sensor is not known
  double noise_mm = 0;             // of all points, if not empty
};

// Gives the blocks' points their certainties by the incidence on the tube of their way to the
// sensor. Distances of points within `reach_mm` of the surface tell the noise; `sigma_mm` is that
// of all of them.
IncidenceWeights WeighByIncidence(const hal::Tube& tube, std::span<const Flattening> flattening,
                                  double sigma_mm, double reach_mm, std::span<PointBlock> blocks,
                                  Workers* workers = nullptr);

}  // namespace bendloop::pipeline
