// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "hal/bend_program.h"
#include "hal/result.h"
#include "pipeline/correction/material.h"

namespace bendloop::pipeline {

// One number for each axis of a row.
struct PerAxis {
  double length_mm = 0;
  double rotation_deg = 0;
  double angle_deg = 0;

  bool operator==(const PerAxis&) const = default;
};

struct CorrectionOptions {
  Material material;
  // Part of the deviation that one correction may take away, 0..1.
  PerAxis gain{1.0, 1.0, 1.0};
  // true: the gain decays as parts of a lot are measured (Kalman), never above `gain` nor below
  // `least_gain`. false: `gain` as it stands.
  bool decaying_gain = true;
  // Keeps following tool wear; 0.05 costs 2.6 % of variance.
  double least_gain = 0.05;
  // 1 sigma of how far a lot's first part may be from the nominal.
  PerAxis lot_sigma{2.0, 2.0, 3.0};
  // 1 sigma of the bender from part to part.
  PerAxis scatter_sigma{0.05, 0.1, 0.1};
  // Changes below so many sigma of the scatter and measurement that are left in them are not made.
  // After n parts that is about sigma / sqrt(n).
  double deadband_sigmas = 1.0;
  // Most that one correction changes; more is cut to this, with a notice.
  PerAxis step_limit{5.0, 5.0, 6.0};
  // Most that a program may differ from its lot's base program; more is refused, not cut.
  PerAxis total_limit{8.0, 10.0, 12.0};
  // Between bends one of which is smaller than this, the rotation has no meaning and stays.
  double least_angle_deg = 2.0;
};

// What is believed of one axis of one row: measured = material model of commanded + offset.
struct OffsetEstimate {
  double offset = 0;
  double variance = 0;        // of the offset: what is not known of the lot, and the noise below
  double noise_variance = 0;  // of the offset: scatter and measurement of the parts seen

  bool operator==(const OffsetEstimate&) const = default;
};

struct LotRow {
  OffsetEstimate length_mm;
  OffsetEstimate rotation_deg;
  OffsetEstimate angle_deg;

  bool operator==(const LotRow&) const = default;
};

// What a lot of tubes has taught so far. Plain numbers, kept by the caller from part to part;
// start anew at each change of lot, tooling or nominal.
struct LotState {
  std::uint32_t parts = 0;  // corrected with
  hal::BendProgram base;    // the lot's first program: total limits count from here
  std::vector<LotRow> rows;

  bool operator==(const LotState&) const = default;
};

// A lot that begins with `base` at the bender, which is expected to make the nominal.
LotState StartLot(const hal::BendProgram& nominal, const hal::BendProgram& base,
                  const CorrectionOptions& options);

// Why an axis is changed by less than the deviation, or not at all.
enum CorrectionFlag : std::uint32_t {
  kFlagDeadband = 1u << 0,      // the change is within the uncertainty: none is made
  kFlagStepLimit = 1u << 1,     // cut to the limit of one step
  kFlagTotalLimit = 1u << 2,    // refused: too far from the base program
  kFlagNotCorrected = 1u << 3,  // this axis of this row is never corrected (first rotation, ...)
  kFlagNoMeaning = 1u << 4,     // rotation next to a bend too small to define it
  kFlagImpossible = 1u << 5,    // refused: no such length or angle exists
  kFlagAtZero = 1u << 6,        // bends without a straight between: the length stays at 0
  kFlagUnexpected = 1u << 7,    // far from what the lot's parts so far predict
};
// "deadband, step limit"; empty for no flags.
std::string FlagNames(std::uint32_t flags);

struct AxisCorrection {
  double commanded = 0;  // of the program that bent the part
  double deviation = 0;  // nominal - measured (a rotation: the short way round)
  double gain = 0;       // part of the deviation that is believed to be the lot's
  double wanted = 0;     // change of the active command before deadband and limits
  double applied = 0;    // change of the active command
  double corrected = 0;  // active + applied
  double sigma = 0;      // 1 sigma of `wanted`, from scatter and measurement
  std::uint32_t flags = 0;
  double active = 0;  // of the program that the next part would be bent with
};

struct RowCorrection {
  AxisCorrection length_mm;
  AxisCorrection rotation_deg;
  AxisCorrection angle_deg;
};

struct Correction {
  hal::BendProgram corrected;  // as many rows as commanded; bend radii as commanded
  std::vector<RowCorrection> rows;
  LotState next;                      // to be kept if this part counts
  std::vector<std::string> notices;   // for a person: what was cut, what is unexpected
  std::vector<std::string> refusals;  // not empty: `corrected` must not be sent
  bool changes_anything = false;

  bool refused() const { return !refusals.empty(); }
};

struct CorrectionInput {
  hal::BendProgram nominal;
  hal::BendProgram commanded;  // the program that bent the measured part
  hal::BendProgram measured;   // in the nominal's order
  hal::BendProgram sigma;      // 1 sigma of `measured`
  // The program that the bender holds now, where it is another one already: tubes bent since (and
  // still to be measured) made it out of what earlier ones taught. The correction aims at the same
  // command as ever and changes this program by what is missing. Empty: `commanded`.
  hal::BendProgram active = {};
};

// corrected = commanded + gain (nominal - measured) / slope, row by row and axis by axis, where the
// slope is the material's d measured / d commanded, and the lengths make up for the stretch of the
// angles' change. kBadInput when shapes differ or values are not finite; a correction that is
// possible but not allowed comes back with refusals.
hal::Result<Correction> Correct(const CorrectionInput& input, const LotState& lot,
                                const CorrectionOptions& options);

}  // namespace bendloop::pipeline
