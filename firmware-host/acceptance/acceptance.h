// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <string>
#include <vector>

#include "firmware-host/acceptance/frame_log.h"
#include "firmware-host/acceptance/rules.h"
#include "firmware-host/acceptance/timing.h"
#include "hal/bend_program.h"

namespace bendloop::host {

enum class Outcome { kNotTried, kPassed, kFailed };

// "pass", "FAIL", "not tried".
const char* Name(Outcome outcome);

// One scripted exchange.
struct Exchange {
  std::size_t number = 0;  // from 1
  std::string name;
  Outcome outcome = Outcome::kNotTried;
  std::vector<Rule> rules;    // that it tried
  std::vector<Rule> broken;   // of these
  std::string detail;         // what was wrong, or why it was not tried
  std::vector<Frame> frames;  // kept where it failed, and where it shows a rule first
};

struct RuleResult {
  Outcome outcome = Outcome::kNotTried;
  std::size_t tried = 0;     // checks
  std::size_t failed = 0;    // of these
  std::string detail;        // of the first failure, or why it was not tried
  std::size_t shown_by = 0;  // number of the exchange whose frames show it; 0: none
};

// What the robot found: everything that the certificate says of the PLC.
struct Acceptance {
  std::string bender;        // "Modbus TCP 127.0.0.1:502 unit 1"
  std::string register_map;  // its name
  hal::ProgramBlock found;   // the program that was active before, and is again
  bool restored = false;
  std::string trouble;  // why the run could not be ended; empty: it was
  std::array<RuleResult, kRuleCount> rules;
  std::vector<Exchange> exchanges;
  std::vector<TimingSummary> timing;
  std::chrono::nanoseconds took{0};

  const RuleResult& of(Rule rule) const { return rules[static_cast<std::size_t>(rule) - 1]; }
  RuleResult& of(Rule rule) { return rules[static_cast<std::size_t>(rule) - 1]; }
  std::size_t Count(Outcome outcome) const;  // rules
  bool passed() const { return Count(Outcome::kFailed) == 0 && trouble.empty() && restored; }
};

}  // namespace bendloop::host
