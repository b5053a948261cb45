// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "pipeline/correction/material.h"

namespace bendloop::pipeline {

// One number for each axis of a row.
struct PerAxis {
  double length_mm = 0;
  double rotation_deg = 0;
  double angle_deg = 0;

  bool operator==(const PerAxis&) const = default;
};

// Half-widths that tubes are judged with; an empty one is not judged.
struct RowTolerances {
  std::optional<double> length_mm;
  std::optional<double> rotation_deg;
  std::optional<double> angle_deg;
};

// How the filter takes a lot's bender to behave before it has seen it. Sizes in mm and degrees are
// 1 sigma. Where no source is named, the figure is the best of a search on the benders of
// bendloop_lots (tests/bench).
struct LotFilterOptions {
  // Of a coil: springback's constant (at 70 degrees), springback's change over 50 degrees of
  // command, stretch. Coils of one steel differ by a few MPa of yield stress and by a few percent
  // of wall, which is half a degree; the first coil is not known any better than its data sheet.
  double first_coil_constant_deg = 2.5;
  double first_coil_slope_deg = 1.0;
  double first_coil_stretch_percent = 2.0;
  double next_coil_constant_deg = 0.8;
  double next_coil_slope_deg = 0.4;
  double next_coil_stretch_percent = 0.8;
  // What is each bend's own: tool, clamp, wall of the bend before. Of a part never bent before, and
  // from one lot of it to the next.
  PerAxis first_row{2.0, 2.0, 1.0};
  PerAxis next_row{0.05, 0.05, 0.05};
  // A tube that slips does so by about this much in one value; a value that jumps, too.
  PerAxis slip{1.0, 1.5, 1.5};
  // Odds, for each tube, of a slip somewhere, of one tube of another coil's springback, of a jump
  // of the coil, of a jump of one value; and for each further value in the same event.
  double slip_odds = 0.01;
  double tube_slip_odds = 0.003;
  double coil_jump_odds = 0.005;
  double row_jump_odds = 0.003;
  double further_value_odds = 0.2;
  // What the odds above count for in a forecast, in parts that the lot has shown; a bender that has
  // shown nothing has less of both than the filter must be prepared for.
  double odds_weight = 40.0;
  double odds_share = 0.5;
  // Parts for which an event stays open to another explanation.
  unsigned open_parts = 3;
  // A temperament is never less likely than e^-this beside the best one: so much evidence makes a
  // bender that was steady all morning one that drifts.
  double least_log_weight = 5.0;
  // How many values of steady parts the scatter above counts for before, and at most, seen ones.
  double scatter_weight = 4.0;
  double most_scatter_weight = 200.0;
  // Hypotheses kept at most.
  unsigned most_hypotheses = 8;

  bool operator==(const LotFilterOptions&) const = default;
};

struct CorrectionOptions {
  Material material;
  // Part of what is wanted that one correction may change, 0..1; 0: the axis is never corrected.
  // The filter weighs the evidence itself: damping beside it only makes it later.
  PerAxis gain{1.0, 1.0, 1.0};
  // 1 sigma of the bender from part to part, until the lot has shown its own.
  PerAxis scatter_sigma{0.05, 0.1, 0.1};
  LotFilterOptions filter;
  // A change is not made below so many sigma of what is known of it, nor below `deadband_scatter`
  // of the bender's scatter, whichever is less: a program is not written anew for nothing.
  double deadband_sigmas = 1.0;
  double deadband_scatter = 0.1;
  // A row known to no better than this (1 sigma, from all parts of the lot) is held by itself.
  PerAxis hold_sigma{0.3, 0.3, 0.2};
  // Most that one correction changes; more is cut to this, with a notice.
  PerAxis step_limit{5.0, 5.0, 6.0};
  // Most that a program may differ from its lot's base program; more is refused, not cut.
  PerAxis total_limit{8.0, 10.0, 12.0};
  // Between bends one of which is smaller than this, the rotation has no meaning and stays.
  double least_angle_deg = 2.0;
  // What the forecast is made for.
  RowTolerances tolerance{0.5, 0.5, 0.5};
};

}  // namespace bendloop::pipeline
