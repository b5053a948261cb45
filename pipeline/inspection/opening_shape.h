// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string_view>

#include "hal/tube_features.h"

namespace bendloop::pipeline {

enum class OpeningKind : std::uint8_t {
  kHole,
  kLeaningHole,  // drilled beside the wall's normal: an oval
  kSlot,
};
std::string_view Name(OpeningKind kind);  // "hole", "leaning hole", "slot"

OpeningKind KindOf(const hal::WallOpening& opening);

// How an opening looks from outside along the wall's normal, whatever made it: so those of one kind
// compare with those of another. What a leaning drill leaves is as long as it is there.
struct OpeningShape {
  double length_mm = 0, width_mm = 0;
  double axis_deg = 0;  // of the length; of what is round nothing
  double lean_deg = 0;  // of a drill's axis, from the wall's normal
};
OpeningShape ShapeOf(const hal::WallOpening& opening);
// 1 sigma of each; `sigma`: of each value of the opening.
OpeningShape ShapeSigma(const hal::WallOpening& opening, const hal::WallOpening& sigma);

// How much longer than its diameter a hole that is told as radial may be: its drill may lean by
// 1 sigma of that.
double LongerByLeanMm(const hal::WallOpening& hole, const hal::WallOpening& sigma);
// Between the axes of both drills.
double AngleBetweenDrillsDeg(const hal::WallOpening& one, const hal::WallOpening& other);

}  // namespace bendloop::pipeline
