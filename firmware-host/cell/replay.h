// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "config/cell_config.h"
#include "firmware-host/cell/bender_desk.h"
#include "firmware-host/cell/part_run.h"
#include "hal/clock.h"
#include "hal/result.h"

namespace bendloop::host {

struct ReplayOptions {
  std::filesystem::path session;
  bool recorded_pace = false;
  // Correct a real bender's program, under all interlocks; false: it is read and never written.
  bool send = false;
  // Of a cell with a real bender; ":memory:" is taken for every other one.
  std::filesystem::path journal = ":memory:";
  // Of the cell as it was, where its bender has been replaced by a simulated one; "": the cell's
  // own.
  std::string config_digest;
  // What the lot has taught, for a session that does not say it.
  std::optional<pipeline::LotState> lot;
};

struct Replay {
  PartOutcome outcome;
  std::vector<std::string> notes;  // for a person
};

// A recorded session through the cell loop, the bender included. The same session and cell give the
// same result. kBadInput for a session that holds no scan or no tube.
hal::Result<Replay> ReplaySession(const config::CellConfig& cell, const ReplayOptions& options,
                                  hal::Clock& clock);

}  // namespace bendloop::host
