// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>

#include "pipeline/fit/surface_fit.h"

namespace bendloop::pipeline {

// The greatest difference between two halves of a scan.
struct HalvesDiffer {
  double sigmas = 0;  // of the difference
  std::string what;   // "bend 3 angle by 0.300 degrees"
};

// Fits `fit` again to each of two random halves of the points and compares lengths, rotations and
// angles: what a scan says must not depend on which of its points are asked. Lengths of the first
// and last row are left out, they come from the borders.
HalvesDiffer CompareHalves(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                           SurfaceFitOptions options);

}  // namespace bendloop::pipeline
