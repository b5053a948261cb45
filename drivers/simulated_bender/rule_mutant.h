// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bitset>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace bendloop::drivers {

// A PLC that breaks one of the rules of drivers/README.md, "What the PLC must do". What each does
// stands in rule_mutant.cc.
enum class RuleMutant : std::uint8_t {
  kHeartbeatStands,
  kHeartbeatSlow,
  kHeartbeatStopsAtFault,
  kIdleWhileBending,
  kIdleWhenNotReady,
  kUnnamedMode,
  kTakesWhenNotIdle,
  kTakesWrongSequence,
  kTakesActiveSequence,
  kTakesTooFewRows,
  kTakesTooManyRows,
  kTakesWrongCrc,
  kTakesBeyondLimits,
  kTakesOtherPart,
  kTakesAnything,
  kRejectsEverything,
  kOtherCrc,
  kCopiesInTwoScans,
  kCopiesNothing,
  kCopiesAllButLastRow,
  kCopiesRowWrong,
  kCopiesRowWrongKeepsCrc,
  kCopiesOldSequence,
  kKeepsStaged,
  kActsWithoutChange,
  kActsOnZero,
  kActivatesLate,
  kRejectsAndActivates,
  kRejectsAndActivatesLate,
  kCallsRejectedAccepted,
  kReplySequenceFirst,
  kAnswersBeforeCopying,
  kAnswersNothing,
  kAnswersOtherSequence,
  kForgetsActive,
  kRestoresOlderProgram,
  kActivatesStagedAtPowerUp,
  kClipsLengths,
  kClipsAngles,
  kRoundsLengths,
  kRoundsRotations,
  kRoundsAngles,
  kKeepsLowWords,
  kDropsRows,
  kEditKeepsCrc,
  kEditClearsCrcOnly,
  kSwapsWords,
  kSwapsBytes,
  kSequence15Bits,
  kRefusesSmallerSequence,
  kActivatesOnStaging,
};

struct RuleMutantFacts {
  RuleMutant mutant;
  int rule;                   // its number in drivers/README.md, 9 for R9
  std::string_view name;      // "takes-wrong-crc"
  std::string_view sentence;  // what it does, for people
};

// Each once, in the order of the enumeration.
std::span<const RuleMutantFacts> RuleMutants();
// nullopt: none has this name.
std::optional<RuleMutant> FindRuleMutant(std::string_view name);
// One line a mutant, for help texts.
std::string RuleMutantHelp();

// Those that are at work.
class RuleMutantSet {
 public:
  void Add(RuleMutant mutant) { set_.set(static_cast<std::size_t>(mutant)); }
  bool Has(RuleMutant mutant) const { return set_.test(static_cast<std::size_t>(mutant)); }
  bool empty() const { return set_.none(); }

 private:
  static constexpr std::size_t kMax = 64;
  std::bitset<kMax> set_;
};

}  // namespace bendloop::drivers
