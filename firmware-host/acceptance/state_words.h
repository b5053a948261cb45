// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <string>

#include "firmware-host/acceptance/bench.h"

namespace bendloop::host {

// R1, with some room for the looks at it.
inline constexpr std::chrono::milliseconds kSlowestBeat{1100};

// R2, as far as one look tells: a code that the map names.
inline void ExpectKnownMode(Bench& bench, const PlcState& state) {
  const hal::RegisterMap& map = bench.plc().map();
  const bool known = state.mode == map.mode_idle || state.mode == map.mode_not_ready ||
                     state.mode == map.mode_bending || state.mode == map.mode_fault;
  bench.Refute(Rule::kMode, known,
               "mode holds " + std::to_string(state.mode) + ", which the map does not name");
}

// R18: the crc of what is active, or "keyed in".
inline void ExpectRightCrc(Bench& bench, const RegisterProgram& active) {
  const bool keyed_in = active.sequence == 0 && active.crc == 0;
  bench.Refute(Rule::kPanel, keyed_in || bench.plc().form().Crc(active) == active.crc,
               "the active crc is not that of the active rows");
}

}  // namespace bendloop::host
