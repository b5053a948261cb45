// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "hal/tube.h"
#include "pipeline/fit/bow_shapes.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/surface_sums.h"
#include "pipeline/tube/easing.h"
#include "pipeline/tube/flattening.h"

namespace bendloop::pipeline {

struct SurfaceAssignment;  // surface_pass.h

// A tube whose straights bow: each begins as what is before it ends, bows from there, and all that
// is behind it goes on from where it ends.
struct BowedTubeState {
  hal::Tube tube;
  std::vector<Flattening> flattening;
  Easing easing;
  std::vector<Bow> bows;  // by segment

  bool is_bowed() const {  // any straight
    return std::any_of(bows.begin(), bows.end(), [](const Bow& bow) { return !bow.is_none(); });
  }
};

// Its spine; each straight is its best-fit line.
EasedSpine SpineOf(const BowedTubeState& state);

// Of its frame: the motion of a straight's line from where it begins to its best-fit line, by its
// modes.
BowMotion ToBestFitLine(const Bow& bow, double line_mm);

// The same straight without any bow: how far it goes, and what its best-fit line is of, which is
// all but its ends, that belong to the bends, and what these ease over. `spine`: as if no straight
// bowed.
Bow ExtentOf(const BowedTubeState& state, const EasedSpine& spine, std::size_t segment);

// Where a bend eases the straight beside it still bows: by so much its pieces turn more.
struct BowHinge {
  std::size_t segment = 0;  // that turns, with all behind it
  Eigen::Vector3d place_mm = Eigen::Vector3d::Zero();
  Eigen::Matrix<double, 3, kBowModes> turn;  // [rad / mm] about it, by the modes
};
// Those of the straight `segment`, in the bend before it or in the one behind it.
std::vector<BowHinge> BowHinges(const EasedSpine& spine, const Easing& within, const Bow& bow,
                                std::size_t segment, bool behind);

// What the bends beside a straight, easing into its middle, make of the best-fit line over that: as
// a motion of its frame. `spine`: as if no straight bowed.
Eigen::Matrix<double, kLocalState, 1> TailsOf(const EasedSpine& spine, const Bow& straight,
                                              std::size_t segment);

// Points near the tube's surface by segment of `spine`, which is the state's; those of straights as
// if these did not bow. `beyond_mm`: of the tube's ends.
SurfaceAssignment PointsOf(const BowedTubeState& state, const EasedSpine& spine, double beyond_mm,
                           std::span<const PointBlock> blocks, double reach_mm);

// How far points go on beyond the ends of the first and of the last straight [mm]; none: too few of
// them are near it.
std::array<std::optional<double>, 2> PointsBeyond(const BowedTubeState& state,
                                                  std::span<const PointBlock> blocks,
                                                  double reach_mm);

// Lets the first and last straight begin and end where points do, as far as these lie near them, or
// so far beyond.
void EndWithPoints(std::span<const PointBlock> blocks, double reach_mm,
                   const std::array<double, 2>& beyond_mm, BowedTubeState& state);

}  // namespace bendloop::pipeline
