// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "hal/bend_program.h"
#include "pipeline/tube/part_variation.h"

namespace bendloop::pipeline {

// From which end a tube was measured, as the cell file may settle it.
enum class DirectionChoice : std::uint8_t { kAuto, kForward, kReverse };

enum class DirectionState : std::uint8_t {
  kForward,     // the measured rows are in the nominal's order
  kReverse,     // measured from the other end: the rows must be reversed
  kAmbiguous,   // both fit: correcting the wrong row is scrap, so a person must say
  kWrongBends,  // another number of bends than the nominal
  kMirrored,    // fits only with the sign of every rotation turned round
  kNoMatch,     // neither fits: this is not the part
};
std::string_view Name(DirectionState state);  // "forward", "reverse", "ambiguous", ...

struct DirectionOptions {
  DirectionChoice choice = DirectionChoice::kAuto;
  PartVariation expected;
  // A row this many expected variations off is not a variation of the part any more: an angle of
  // 16 to 24 degrees, a rotation of 10. Springback without any correction is half of that.
  double plausible_row = 5.0;
  // Root mean square over all rows, in expected variations.
  double plausible_rms = 3.0;
  // Least difference of the two costs (twice the logarithm of the likelihood ratio; 23 is a ratio
  // of 100 000 to 1).
  double decisive_difference = 23.0;
};

// How well a measured program fits the nominal one way round.
struct DirectionFit {
  double cost = 0;   // sum of squared differences in expected variations
  double rms = 0;    // root of the mean of the same
  double worst = 0;  // the largest difference, in expected variations
  std::size_t worst_row = 0;
  double residual_mm = 0;  // rms of tube ends and tangent points after the best-fit motion
  bool plausible = false;
};

struct DirectionMatch {
  DirectionState state = DirectionState::kNoMatch;
  bool reversed = false;  // the better of the two, also when held
  DirectionFit forward;
  DirectionFit reverse;
  std::string message;  // for a setter: what was found and, when held, the question

  // Whether rows may be compared and corrected.
  bool settled() const {
    return state == DirectionState::kForward || state == DirectionState::kReverse;
  }
};

// `sigma` has the measured program's shape; missing rows count as exact.
DirectionMatch MatchDirection(const hal::BendProgram& nominal, const hal::BendProgram& measured,
                              const hal::BendProgram& sigma, const DirectionOptions& options);

}  // namespace bendloop::pipeline
