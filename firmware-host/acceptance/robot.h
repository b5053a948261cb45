// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "firmware-host/acceptance/acceptance.h"
#include "firmware-host/acceptance/bench.h"
#include "firmware-host/acceptance/hand_steps.h"
#include "firmware-host/acceptance/plc.h"
#include "firmware-host/acceptance/restore.h"
#include "hal/result.h"

namespace bendloop::host {

struct RobotOptions {
  BenchOptions bench;
  std::function<void(const Exchange&)> on_exchange = {};
};

// Plays all exchanges against the PLC and puts back the program that it found; one that an earlier
// run left behind is put back first. Errors say why nothing was tried: the bender does not answer,
// is not idle or holds no program, the file cannot be written. What goes wrong later is told in the
// result.
hal::Result<Acceptance> RunAcceptance(Plc& plc, const RestoreFile& file, HandSteps& hands,
                                      const RobotOptions& options);

// Puts back what an earlier run left behind. The line for the setter.
hal::Result<std::string> RestoreAfterCut(Plc& plc, const RestoreFile& file,
                                         const BenchOptions& options);

}  // namespace bendloop::host
