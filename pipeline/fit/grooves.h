// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "pipeline/fit/surface_fit.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// A straight whose wall goes up and down along it.
struct GroovesFound {
  std::size_t straight = 0;  // from 0
  double rms_mm = 0;         // about the tube, without noise
};

// Corrugated hoses and threaded rods: points of a short piece of the wall lie off the tube
// together, and the next piece does otherwise. Of tubes whose points lie nearer to them than such
// walls nothing is asked. `fit`: of all points.
std::vector<GroovesFound> FindGrooves(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                                      double reach_mm);

// That the pipe radius is one between crests and troughs.
void SayGrooves(std::span<const GroovesFound> grooves, Measurement& measurement);

}  // namespace bendloop::pipeline
