// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <span>

namespace bendloop::pipeline {

// [of depth] 1 sigma of a dent that is known no better was not fitted.
inline constexpr double kVagueDepth = 0.33;

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

// Place, depth and area of a dent from the points about it: least squares of
// D (1 + (2^t - 1) q^s)^(-1/t) on a smooth wall, q a quadratic form of the place on the unrolled
// surface, 1 where the dent is half as deep as in its middle. The power s tells round dents (1: a
// gaussian, where t is nothing) from flats, the tail t how slowly it runs out: below nothing it
// ends, where (1 - 2^t) q^s is 1. What is certainly no ellipse may be a jaw's flat, the product of
// two such depths along and around the tube (dent_shapes.h).
// `points`: within `reach_mm` of a place where it is about `depth_mm` deep and `size_mm` wide.
FittedDent FitDent(std::span<const WallPoint> points, double reach_mm, double depth_mm,
                   double size_mm, double pipe_radius_mm, double noise_mm);
// Whether they certainly show one there, whatever its form: a few samples at the edge of what a
// scan sees, or behind the wall, make cells look pressed in, and those all around do not.
bool IsShown(std::span<const WallPoint> points, double reach_mm, double depth_mm, double size_mm,
             double pipe_radius_mm, double noise_mm);
// So far off the round wall points may be of such a dent and of the wall about it.
double MostOffWallMm(double depth_mm, double noise_mm);

}  // namespace bendloop::pipeline
