// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <span>

#include "pipeline/features/opening_border.h"
#include "pipeline/features/plane_samples.h"

namespace bendloop::pipeline {

// [of r_P] From the middle: what is further aside is seen along the surface.
constexpr double kLimb = 0.9;

// How far a place may be from the nearest sample beside an opening.
double GapBeside(const OpeningBorder& border, const PlaneSamples& present, double pipe_radius_mm);

// Whether it is so narrow that it may be such a gap, which is as wide as two.
bool IsNarrow(const OpeningBorder& border, double gap_mm);

// The sides of a border, and those that have samples.
struct BorderSides {
  int with_samples = 0, all = 0;
  // But an eighth: one of eight, three of two dozen.
  bool AreAllButByChance() const { return all - with_samples <= std::max(1, all / 8); }
};
// By the samples up to `reach_mm` outside of it and `clear_mm` inside; the more there are, the more
// sides, each of `least_side_mm` or more, but eight at least.
BorderSides SidesOf(const OpeningBorder& border, std::span<const Eigen::Vector2d> wall,
                    double clear_mm, double reach_mm, double least_side_mm);

// How much likelier [log] than a cut the edge of what nobody saw is, a shadow's or where the wall
// turns away from all who looked: there samples become fewer towards it, beside a cut they are as
// dense as further out. The sector that says the most has no say: another pass may end there.
double LogOddsOfShadow(const OpeningBorder& border, std::span<const Eigen::Vector2d> wall,
                       double gap_mm, double pipe_radius_mm);

// Whether places of its size and direction beside an opening are empty, too, as those between laser
// lines are, or nobody can tell. `present`: samples up to `reach_mm` from the middle of the plane.
// `least_sides`: only places count that have some on this part of their sides, no further away than
// they are wide; others lie where what is present ends.
bool IsLikeItsSurroundings(const OpeningBorder& border, std::span<const Eigen::Vector2d> present,
                           double reach_mm, double pipe_radius_mm, double least_sides = 0.0);

}  // namespace bendloop::pipeline
