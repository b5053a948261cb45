// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>

#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// By how much a pass of the scan may lie beside the others: 1 sigma of each axis. Arms with
// scanners drift by 0.02 to 0.1 mm between passes.
struct PassDrift {
  double move_mm = 0.05;
  double turn_deg = 0.02;
};

// The pass of a scan that lies furthest beside what the others say together.
struct PassBeside {
  std::size_t number = 1;  // counted from 1
  double moved_mm = 0, turned_deg = 0;
  // Further is no drift: six times what drift makes of this difference.
  double limit_mm = 0, limit_deg = 0;

  bool is_moved() const { return !(moved_mm <= limit_mm && turned_deg <= limit_deg); }
  // "pass 2 of the scan lies 1.02 mm and 0.010 degrees beside the others".
  std::string Text() const;
};

// What to do about a pass that drift does not explain.
inline constexpr char kMovedTube[] =
    "the tube was moved while it was scanned, or the arm lost its place; scan the tube again";

// Empty: the passes meet, or there is one.
std::optional<PassBeside> FurthestPass(std::span<const PassOffset> passes, const PassDrift& drift);

}  // namespace bendloop::pipeline
