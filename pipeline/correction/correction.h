// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "hal/bend_program.h"
#include "hal/result.h"
#include "pipeline/correction/correction_options.h"
#include "pipeline/correction/forecast.h"
#include "pipeline/correction/lot_state.h"
#include "pipeline/tube/joint_uncertainty.h"

namespace bendloop::pipeline {

// Why an axis is changed by less than the deviation, or not at all.
enum CorrectionFlag : std::uint32_t {
  kFlagDeadband = 1u << 0,      // the change is within the uncertainty, and small: none is made
  kFlagStepLimit = 1u << 1,     // cut to the limit of one step
  kFlagTotalLimit = 1u << 2,    // refused: too far from the base program
  kFlagNotCorrected = 1u << 3,  // this axis of this row is never corrected (first rotation, ...)
  kFlagNoMeaning = 1u << 4,     // rotation next to a bend too small to define it
  kFlagImpossible = 1u << 5,    // refused: no such length or angle exists
  kFlagAtZero = 1u << 6,        // bends without a straight between: the length stays at 0
  kFlagUnexpected = 1u << 7,    // far from what the lot's parts so far predict
  kFlagUncertain = 1u << 8,     // held by itself: it is not known well enough
  kFlagLotHeld = 1u << 9,       // somebody holds the lot: nothing is changed
};
// "deadband, step limit"; empty for no flags.
std::string FlagNames(std::uint32_t flags);

struct AxisCorrection {
  double commanded = 0;  // of the program that bent the part
  double deviation = 0;  // nominal - measured (a rotation: the short way round)
  double gain = 0;       // part of what was not expected that is believed to stay
  double wanted = 0;     // change of the active command before deadband and limits
  double applied = 0;    // change of the active command
  double corrected = 0;  // active + applied
  double sigma = 0;      // 1 sigma of `wanted`: how well the lot is known
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
  Forecast forecast;  // of the next tube, with `corrected` (refused: as if it were sent)

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
  // Which errors of `measured` go together; in its order.
  std::vector<Correlation> correlations = {};
  // The tube that will be the first of the corrected program is bent so many after this one: 1, and
  // more where tubes wait between bender and scanner.
  unsigned ahead = 1;
  // Tubes bent since the one that the lot learnt from last, this one included.
  unsigned since_last = 1;
};

// Learns the part (lot_filter.h) and aims the active program at the nominal by what the lot is then
// believed to do with the tube that is bent next. kBadInput when shapes differ or values are not
// finite; a correction that is possible but not allowed comes back with refusals.
hal::Result<Correction> Correct(const CorrectionInput& input, const LotState& lot,
                                const CorrectionOptions& options);

}  // namespace bendloop::pipeline
