// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cli/acceptance_hands.h"

#include <cstdlib>
#include <iostream>

namespace bendloop::host {
namespace {

struct StepWords {
  const char* request;    // for a person
  const char* simulated;  // for the simulated bender
};

StepWords WordsOf(HandStep step) {
  switch (step) {
    case HandStep::kStartCycle:
      return {"Start a dry cycle that takes a while, without a tube", "mode bending"};
    case HandStep::kOpenGuard:
      return {"Open a guard, so that the machine is not ready", "mode not-ready"};
    case HandStep::kFault:
      return {"Bring the machine into fault (emergency stop)", "mode fault"};
    case HandStep::kMakeIdle:
      return {"Make it ready for a program again", "mode idle"};
    case HandStep::kPowerCycle:
      return {"Switch the PLC off and on again", "reboot"};
    case HandStep::kEditAtPanel:
      return {"Change one value of the active program at the panel by a little", "edit 0.5"};
    case HandStep::kStopProgram:
      return {"Stop the PLC's program (STOP)", "freeze"};
    case HandStep::kStartProgram:
      return {"Let it run again, and make the machine ready", "behave"};
  }
  return {"", ""};
}

}  // namespace

bool TerminalHands::Do(HandStep step) {
  std::cerr << "\n" << WordsOf(step).request << ".\nEnter when it is so, s and Enter to skip: ";
  std::string line;
  return std::getline(std::cin, line) && line.empty();
}

bool CommandHands::Do(HandStep step) {
  return std::system((command_ + " " + Word(step)).c_str()) == 0;
}

bool SimulatorHands::Do(HandStep step) {
  return bender_.Misbehave(WordsOf(step).simulated).has_value();
}

}  // namespace bendloop::host
