// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <string_view>

#include "drivers/simulated_bender/rule_mutant.h"
#include "hal/bender_state.h"
#include "hal/result.h"

namespace bendloop::drivers {

// What the simulated bender does wrong at the moment. Marked (once): over after its first use.
struct Misbehaviour {
  enum class Answer : std::uint8_t {
    kGood,
    kSilent,            // does nothing, says nothing
    kMute,              // does it, says nothing
    kException,         // does nothing, answers `exception`
    kGarbage,           // answers noise
    kShort,             // answers the first half of the answer and no more
    kWrongUnit,         // answers as another unit
    kWrongTransaction,  // answers another transaction
  };
  Answer answer = Answer::kGood;
  std::uint8_t exception = 4;
  std::chrono::milliseconds late{0};              // requests are done and answered so much later
  std::chrono::milliseconds acknowledge_late{0};  // commits are handled so much later
  std::uint32_t reject_code = 0;                  // (once) the next commit is rejected so
  bool half_write = false;                        // (once) half of the next staged write is kept
  bool drop_after_stage = false;   // (once) hangs up on the commit, which is not done
  bool drop_after_commit = false;  // (once) does the commit, then hangs up
  bool away_after_commit = false;  // (once) does the commit, then neither does nor answers anything
  bool refuse_report = false;      // what is written for the PLC to read (Modbus)
  bool freeze = false;             // the heartbeat stands still
  RuleMutantSet broken;            // rules of the PLC
};

// What a command asks for, beside the settings of Misbehaviour.
enum class MisbehaviourEvent : std::uint8_t {
  kNone,
  kReboot,
  kOtherProgram,
  kEdit,
  kSetCount,
  kLyingRows,
  kMode
};

struct MisbehaviourCommand {
  MisbehaviourEvent event = MisbehaviourEvent::kNone;
  hal::BenderMode mode = hal::BenderMode::kIdle;  // of kMode
  double angle_deg = 0;                           // of kEdit
  std::uint32_t count = 0;                        // of kSetCount
};

// One line per command, for help texts.
std::string_view MisbehaviourHelp();

// Applies "late 500", "silent", "behave", ... to `now`. kUsage, naming all faults, for anything
// else.
hal::Result<MisbehaviourCommand> ParseMisbehaviour(std::string_view command, Misbehaviour& now);

}  // namespace bendloop::drivers
