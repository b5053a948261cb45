// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>

#include "drivers/simulated_bender/simulated_bender.h"
#include "firmware-host/acceptance/hand_steps.h"

namespace bendloop::host {

// Asks on the terminal, and waits for Enter.
class TerminalHands final : public HandSteps {
 public:
  bool Do(HandStep step) override;
};

// Runs `command cycle`, `guard`, `fault`, `idle`, `edit`, `power-cycle`, `stop` or `start`; done
// when it exits with 0.
class CommandHands final : public HandSteps {
 public:
  explicit CommandHands(std::string command) : command_(std::move(command)) {}
  bool Do(HandStep step) override;

 private:
  const std::string command_;
};

// Does it to the simulated bender.
class SimulatorHands final : public HandSteps {
 public:
  explicit SimulatorHands(drivers::SimulatedBender& bender) : bender_(bender) {}
  bool Do(HandStep step) override;

 private:
  drivers::SimulatedBender& bender_;
};

}  // namespace bendloop::host
