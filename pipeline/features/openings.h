// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "hal/tube.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/tube_ends.h"
#include "pipeline/math/workers.h"
#include "pipeline/tube/easing.h"
#include "pipeline/tube/tube_features.h"

namespace bendloop::pipeline {

// Holes and slots through the wall: places where no sample lies, neither on the surface nor above
// it, though they are dense all around, as densely as an opening of one clear border leaves them.
// What the scanner did not reach, what a clamp hides and the gaps between laser lines are no holes.
// `tube`: with all that is on its ends. `sigma_mm`: noise of the points.
std::vector<OpeningFound> FindOpenings(const hal::Tube& tube, const Easing& easing,
                                       const TubeEnds& ends, double sigma_mm,
                                       std::span<const PointBlock> blocks,
                                       Workers* workers = nullptr);

// A border in the plane across an opening's axis: a circle, or two half circles with lines between.
struct OpeningBorder {
  Eigen::Vector2d middle_mm = Eigen::Vector2d::Zero();
  double length_mm = 0, width_mm = 0;
  double axis_rad = 0;  // of the length, from x
  bool is_hole() const { return length_mm == width_mm; }

  // Positive outside.
  double DistanceMm(const Eigen::Vector2d& place_mm) const;
  double AreaMm2() const;
};
struct FittedOpening {
  OpeningBorder border, sigma;
};
// The border that samples of the wall leave free (posterior.h), from one that is about right.
// `smear_mm`: 1 sigma by which noise displaces the samples.
FittedOpening FitOpening(std::span<const Eigen::Vector2d> samples, const OpeningBorder& about,
                         double smear_mm);

}  // namespace bendloop::pipeline
