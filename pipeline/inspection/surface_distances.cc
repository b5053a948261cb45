// SPDX-License-Identifier: Apache-2.0
#include "pipeline/inspection/surface_distances.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "hal/spine.h"
#include "pipeline/tube/spine_distance.h"

namespace bendloop::pipeline {
namespace {

// Smallest value that `part` of all do not exceed; reorders `values`.
double Quantile(std::vector<double>& values, double part) {
  if (values.empty()) return 0;
  const auto rank = static_cast<std::size_t>(std::ceil(part * static_cast<double>(values.size())));
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(std::max<std::size_t>(rank, 1) - 1);
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

}  // namespace

SurfaceDistances DistancesFromSurface(std::span<const SurfaceSample> samples_W,
                                      const hal::BendProgram& nominal, double pipe_radius_mm,
                                      const hal::Pose& X_NW, double end_excess_mm, double noise_mm,
                                      std::optional<double> tolerance_mm, double decision_sigmas) {
  SurfaceDistances out;
  out.tolerance_mm = tolerance_mm;
  const SpineDistance axis(hal::SpineSegments(nominal, {}),
                           pipe_radius_mm + std::max(0.0, end_excess_mm));
  out.distance_mm.reserve(samples_W.size());
  std::vector<double> sizes;
  sizes.reserve(samples_W.size());
  double squares = 0;
  for (const SurfaceSample& sample : samples_W) {
    const double distance = axis(X_NW * sample.position_mm) - pipe_radius_mm;
    out.distance_mm.push_back(distance);
    sizes.push_back(std::abs(distance));
    squares += distance * distance;
  }
  if (sizes.empty()) return out;
  out.rms_mm = std::sqrt(squares / static_cast<double>(sizes.size()));
  out.max_abs_mm = *std::max_element(sizes.begin(), sizes.end());
  out.p99_abs_mm = Quantile(sizes, 0.99);
  out.p95_abs_mm = Quantile(sizes, 0.95);
  out.state = Judge(out.p99_abs_mm, noise_mm, tolerance_mm, decision_sigmas);
  return out;
}

}  // namespace bendloop::pipeline
