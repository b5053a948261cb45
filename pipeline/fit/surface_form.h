// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "pipeline/fit/bowed_spine.h"
#include "pipeline/fit/surface_fit.h"
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

// [of r_P] How far in cells of the surface lie that show a dent. Where it is much smaller than a
// pipe radius they show a quarter of its depth: shallower ones may be dents for what asks their
// points.
inline constexpr double kDentInCells = 0.012, kPerhapsDentInCells = 0.005;

// `tube`: of the fit, with its ends. `noise_mm`: 1 sigma of a point.
// Straights of a bowed tube are looked at as if they did not bow. `least_dent`: [of r_P] in cells.
SurfaceForm FindForm(const BowedTubeState& state, double noise_mm,
                     std::span<const PointBlock> blocks, double reach_mm,
                     double least_dent = kDentInCells);
SurfaceForm FindForm(const SurfaceFit& fit, const hal::Tube& tube, double noise_mm,
                     std::span<const PointBlock> blocks, double reach_mm,
                     double least_dent = kDentInCells);

}  // namespace bendloop::pipeline
