// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <span>
#include <vector>

#include "hal/tube.h"
#include "pipeline/features/cut_faces.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/tube_ends.h"
#include "pipeline/tube/easing.h"
#include "pipeline/tube/flattening.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// What a tube's bends are beside sharp and round.
struct WallForm {
  const Easing& easing;
  std::span<const Flattening> flattening;  // of every bend, or none
};

// Place, depth and area of dents that were seen in cells of the surface (fit/surface_form.h), from
// the points themselves: least squares of D (1 + (2^t - 1) q^s)^(-1/t) on a smooth wall, q a
// quadratic form of the place on the unrolled surface, 1 where the dent is half as deep as in its
// middle. The power s tells round dents (1: a gaussian, where t is nothing) from flats, the tail t
// how slowly it runs out: below nothing it ends, where (1 - 2^t) q^s is 1. What cannot be fitted
// stays as the cells have it, its depth known to about itself or worse, where its points show one;
// else it goes. Those that cells hardly show (kDentInCells) are told only where they are fitted,
// and for certain. The deepest first, each once: cells may have parted one, or taken what is beside
// it or opposite it for pressed in. `faces`: where the wall was cut; what is seen of them is no
// wall. `noise_mm`: 1 sigma of a point along the normal. `wall`: how its bends ease and are
// flattened; places are those of `tube`, whose bends are sharp and round.
void MeasureDents(const hal::Tube& tube, const WallForm& wall, const TubeEnds& ends,
                  const CutFaces& faces, double noise_mm, std::span<const PointBlock> blocks,
                  std::vector<DentFound>& dents);

// A point of the wall about a dent: along the tube and around it on the unrolled surface, and out
// of the round one [mm].
struct WallPoint {
  double along_mm = 0, around_mm = 0, off_mm = 0;
};
struct FittedDent {
  double along_mm = 0, around_mm = 0, depth_mm = 0, area_mm2 = 0;
  double along_sigma_mm = 0, around_sigma_mm = 0, depth_sigma_mm = 0, area_sigma_mm2 = 0;
  double misfit = 0;     // of chi square, for each point that is free: 1 where it explains them
  bool is_step = false;  // its flanks are steeper than those of a flat
  bool is_fitted = false;

  // Whether it is about what was looked at.
  bool IsWithin(double reach_mm) const { return std::hypot(along_mm, around_mm) < 0.7 * reach_mm; }
};
// `points`: within `reach_mm` of a place where it is about `depth_mm` deep and `size_mm` wide.
FittedDent FitDent(std::span<const WallPoint> points, double reach_mm, double depth_mm,
                   double size_mm, double pipe_radius_mm, double noise_mm);
// Whether they certainly show one there, whatever its form: a few samples at the edge of what a
// scan sees, or behind the wall, make cells look pressed in, and those all around do not.
bool IsShown(std::span<const WallPoint> points, double reach_mm, double depth_mm, double size_mm,
             double pipe_radius_mm, double noise_mm);

}  // namespace bendloop::pipeline
