// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <span>

namespace bendloop::pipeline {

// A border in the plane across the surface normal of a place: what a drill leaves that is round, or
// a line long. x goes along the tube, y round it.
struct OpeningBorder {
  Eigen::Vector2d middle_mm = Eigen::Vector2d::Zero();  // where the drill's axis meets the wall
  double length_mm = 0, width_mm = 0;
  double axis_rad = 0;  // of the length, from x
  // Of a hole: how far the drill's axis goes aside for each mm out of the wall; what that leaves
  // depends on the wall's radius (0: flat).
  Eigen::Vector2d lean = Eigen::Vector2d::Zero();
  double pipe_radius_mm = 0;
  bool is_bent = false;  // the wall along, too: what a lean leaves of it is known roughly
  bool is_hole() const { return length_mm == width_mm; }

  // Directions of the length and of the width.
  Eigen::Vector2d Axis() const { return {std::cos(axis_rad), std::sin(axis_rad)}; }
  Eigen::Vector2d Across() const { return {-std::sin(axis_rad), std::cos(axis_rad)}; }
  // Positive outside.
  double DistanceMm(const Eigen::Vector2d& place_mm) const;
  double AreaMm2() const;  // as seen along the surface normal
};
// Where a ray met no wall; y is known to 1 sigma.
struct MissedPlace {
  Eigen::Vector2d place_mm = Eigen::Vector2d::Zero();
  double sideways_sigma_mm = 0;
};
struct FittedOpening {
  OpeningBorder border, sigma;
};
// The border that samples of the wall leave free (posterior.h), from one that is about right. A
// hole is a slot, or leans, where that is certain (5 sigma). `smear_mm`: 1 sigma by which noise
// displaces the samples along the wall. `missed`: where rays met no wall, of samples that come in
// laser lines. `scattered`: of the samples those that come scattered, by who looked through the
// opening: how dense they are tells of the empty place.
FittedOpening FitOpening(std::span<const Eigen::Vector2d> samples, const OpeningBorder& about,
                         double smear_mm, std::span<const MissedPlace> missed,
                         std::span<const Eigen::Vector2d> scattered);
inline FittedOpening FitOpening(std::span<const Eigen::Vector2d> samples,
                                const OpeningBorder& about, double smear_mm) {
  return FitOpening(samples, about, smear_mm, {}, samples);
}

// Samples per area in a band beside a border, and how that grows over the place [part of it a mm]:
// where one pass of the scan ends, one side has more than the other.
struct SampleDensity {
  double per_mm2 = 0;
  Eigen::Vector2d slope = Eigen::Vector2d::Zero();

  // Samples that an opening takes away; `about_mm`: where `per_mm2` is.
  double Missing(const OpeningBorder& border, const Eigen::Vector2d& about_mm) const {
    return per_mm2 * border.AreaMm2() * (1.0 + slope.dot(border.middle_mm - about_mm));
  }
};
SampleDensity DensityBeside(const OpeningBorder& border, std::span<const Eigen::Vector2d> wall);

}  // namespace bendloop::pipeline
