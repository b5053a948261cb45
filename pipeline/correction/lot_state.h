// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

#include "hal/bend_program.h"
#include "pipeline/correction/correction_options.h"

namespace bendloop::pipeline {

// How a bender moves from part to part; the lot finds out which it is.
enum class Temperament : std::uint8_t {
  kSteady,     // it stays where it is
  kWandering,  // each part a little way from the last, to either side
  kDrifting,   // the same way each time
  kRestless,   // wandering by half of its scatter
  kRough,      // steady, with far more scatter than the settings say
};
std::string_view Name(Temperament temperament);  // "steady", ...
inline constexpr std::size_t kTemperaments = 5;

// What a part was taken for that did not fit its lot.
enum class LotEvent : std::uint8_t {
  kNone,
  kSlip,      // this tube only
  kRowJump,   // some values, from now on
  kCoilJump,  // springback and stretch, from now on
};
std::string_view Name(LotEvent event);  // "none", "slip", "jump of a row", "jump of the coil"

// One story of what the lot has been like, and what follows from it. Plain numbers.
struct LotHypothesis {
  Temperament temperament = Temperament::kSteady;
  double log_weight = 0;
  double behind = 0;  // by how much it has lately been less likely than it is taken to be
  LotEvent event = LotEvent::kNone;   // the latest
  std::uint32_t parts_since = 0;      // the event; 0: the latest part was it
  std::vector<std::uint32_t> values;  // that it touched, as TubeValues counts
  PerAxis scatter;                    // 1 sigma of the bender, from part to part
  PerAxis scatter_weight;             // values that it is known from
  std::vector<double> mean;           // as LotLayout
  std::vector<double> covariance;     // its lower triangle, row by row

  bool operator==(const LotHypothesis&) const = default;
};

// What a lot of tubes has taught so far. Plain numbers, kept by the caller from part to part.
struct LotState {
  std::uint32_t number = 1;  // of the lot, counted from 1 for part and tool
  std::uint32_t parts = 0;   // corrected with
  bool held = false;         // by somebody: it learns, and changes no program
  std::uint32_t slips = 0;   // in all lots of the part
  std::uint32_t jumps = 0;
  std::uint32_t parts_of_all_lots = 0;
  hal::BendProgram base;                  // the lot's first program: total limits count from here
  std::vector<LotHypothesis> hypotheses;  // the likeliest first

  bool operator==(const LotState&) const = default;
};

// A part never bent before, with `base` at the bender, which is expected to make the nominal.
LotState StartLot(const hal::BendProgram& nominal, const hal::BendProgram& base,
                  const CorrectionOptions& options);
// Another coil, or whatever else a setter means by a new lot, of the same part on the same tools:
// springback and stretch are open again, what is each bend's own is kept. `base` as above.
LotState NextLot(const LotState& ended, const hal::BendProgram& base,
                 const CorrectionOptions& options);

}  // namespace bendloop::pipeline
