// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace bendloop::host {

// What somebody at the machine does when the robot asks for it.
enum class HandStep : std::uint8_t {
  kStartCycle,    // a cycle runs, and goes on until kMakeIdle
  kOpenGuard,     // not ready for a cycle
  kFault,         // in fault: emergency stop
  kMakeIdle,      // ready for a program again
  kPowerCycle,    // the PLC's power off and on
  kEditAtPanel,   // change one value of the active program at the panel
  kStopProgram,   // the PLC's program stops (STOP); its network may go on
  kStartProgram,  // it runs again
};

// "cycle", "guard", "fault", "idle", "power-cycle", "edit", "stop", "start": for a script that does
// it.
const char* Word(HandStep step);

class HandSteps {
 public:
  virtual ~HandSteps() = default;
  // Returns when it is done; false: it is not, and what needs it is left out.
  virtual bool Do(HandStep step) = 0;
};

// Nobody is there.
class NoHands final : public HandSteps {
 public:
  bool Do(HandStep /*step*/) override { return false; }
};

}  // namespace bendloop::host
