// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "pipeline/fit/bowed_spine.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// What is left of the samples beside lines, arcs and one section.
struct SurfaceForm {
  std::vector<StraightForm> straights;  // one more than bends
  std::vector<DentFound> dents;         // the deepest first
  // Variance, beyond noise, of the distances that a side of a straight has all along it: sections
  // that are not round, and passes that do not meet. It moves the pipe radius and no noise tells.
  double sides_mm2 = 0;
};

// How far in cells of the surface lie that show a dent.
struct DentInCells {
  double least;  // [of r_P]
  // [sigma] Of what all cells scatter by.
  double scatter_sigmas = 7.0;
  // [sigma] And of what noise leaves of its own cell's mean, which few points tell at the edge of
  // what a scan sees. Of thousands of cells one is 4 off by chance.
  double noise_sigmas = 5.0;
};
inline constexpr DentInCells kClearDents{0.012};
// Where a dent is much smaller than a pipe radius cells show a quarter of its depth: for what asks
// their points.
inline constexpr DentInCells kPerhapsDents{0.005};
// What a bend may have left of a dent that it has taken in: for what fits without it.
inline constexpr DentInCells kFaintDents{0.003, 3.5, 3.0};

// `state`: with its ends. `noise_mm`: 1 sigma of a point.
// Straights of a bowed tube are looked at as if they did not bow.
SurfaceForm FindForm(const BowedTubeState& state, double noise_mm,
                     std::span<const PointBlock> blocks, double reach_mm,
                     const DentInCells& dents = kClearDents);

}  // namespace bendloop::pipeline
