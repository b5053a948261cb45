// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_bender/rule_mutant.h"

#include <cstdio>

namespace bendloop::drivers {
namespace {

using M = RuleMutant;

constexpr RuleMutantFacts kMutants[] = {
    {M::kHeartbeatStands, 1, "heartbeat-stands", "never counts its heartbeat"},
    {M::kHeartbeatSlow, 1, "heartbeat-slow", "counts its heartbeat every 5 s"},
    {M::kHeartbeatStopsAtFault, 1, "heartbeat-stops-at-fault", "counts no heartbeat at fault"},
    {M::kIdleWhileBending, 2, "idle-while-bending", "shows idle while a cycle runs"},
    {M::kIdleWhenNotReady, 2, "idle-when-not-ready", "shows idle when it is not ready"},
    {M::kUnnamedMode, 2, "unnamed-mode", "shows a mode that the map does not name, when idle"},
    {M::kTakesWhenNotIdle, 5, "takes-when-not-idle", "takes a program when it is not idle"},
    {M::kTakesWrongSequence, 6, "takes-wrong-sequence",
     "takes what is staged under another number"},
    {M::kTakesActiveSequence, 7, "takes-active-sequence", "takes the active sequence once more"},
    {M::kTakesTooFewRows, 8, "takes-too-few-rows", "takes a program of one row, or of none"},
    {M::kTakesTooManyRows, 8, "takes-too-many-rows",
     "takes a row count above what it holds, and cuts it off"},
    {M::kTakesWrongCrc, 9, "takes-wrong-crc", "does not compare the crc"},
    {M::kTakesBeyondLimits, 10, "takes-beyond-limits", "takes values outside its limits"},
    {M::kTakesOtherPart, 11, "takes-other-part", "takes a program of a part that is not set up"},
    {M::kTakesAnything, 5, "takes-anything", "checks nothing at all (R5 to R11)"},
    {M::kRejectsEverything, 12, "rejects-everything", "rejects good programs, too"},
    {M::kOtherCrc, 9, "other-crc", "computes another crc than the one of drivers/README.md"},
    {M::kCopiesInTwoScans, 13, "copies-in-two-scans", "copies half of the rows 400 ms later"},
    {M::kCopiesNothing, 13, "copies-nothing", "answers accepted and keeps the old program"},
    {M::kCopiesAllButLastRow, 13, "copies-all-but-last-row", "does not copy the last row"},
    {M::kCopiesRowWrong, 13, "copies-row-wrong",
     "changes the first angle when it copies, and makes the crc fit"},
    {M::kCopiesRowWrongKeepsCrc, 13, "copies-row-wrong-keeps-crc",
     "changes the first angle when it copies, and keeps the crc"},
    {M::kCopiesOldSequence, 13, "copies-old-sequence", "leaves the active sequence as it was"},
    {M::kKeepsStaged, 14, "keeps-staged", "does not set the staged sequence to 0"},
    {M::kActsWithoutChange, 16, "acts-without-change",
     "does a commit at each write, though the register has not changed"},
    {M::kActsOnZero, 4, "acts-on-zero", "takes a 0 in commit for the staged sequence"},
    {M::kActivatesLate, 16, "activates-late", "does a commit 4 s later"},
    {M::kRejectsAndActivates, 15, "rejects-and-activates",
     "answers rejected and takes the program"},
    {M::kRejectsAndActivatesLate, 15, "rejects-and-activates-late",
     "answers rejected, and 4 s later takes what is staged then"},
    {M::kCallsRejectedAccepted, 16, "calls-rejected-accepted", "answers accepted when it rejects"},
    {M::kReplySequenceFirst, 16, "reply-sequence-first",
     "writes reply_sequence, and reply and reply_code 400 ms later"},
    {M::kAnswersBeforeCopying, 13, "answers-before-copying", "answers 400 ms before it copies"},
    {M::kAnswersNothing, 16, "answers-nothing", "does commits and never answers"},
    {M::kAnswersOtherSequence, 16, "answers-other-sequence",
     "answers with a number too large by 1"},
    {M::kForgetsActive, 17, "forgets-active", "holds no program after a power loss"},
    {M::kRestoresOlderProgram, 17, "restores-older-program",
     "holds the program from before the last commit after a power loss"},
    {M::kActivatesStagedAtPowerUp, 17, "activates-staged-at-power-up",
     "takes what was staged when its power comes back"},
    {M::kClipsLengths, 3, "clips-lengths", "clips staged lengths to 50 mm"},
    {M::kClipsAngles, 3, "clips-angles", "clips staged angles to 30 degrees"},
    {M::kRoundsLengths, 3, "rounds-lengths", "rounds staged lengths to 1 mm"},
    {M::kRoundsRotations, 3, "rounds-rotations", "rounds staged rotations to 1 degree"},
    {M::kRoundsAngles, 3, "rounds-angles", "rounds staged angles to 1 degree"},
    {M::kKeepsLowWords, 3, "keeps-low-words",
     "keeps the low 16 bits of staged 32-bit lengths and angles"},
    {M::kDropsRows, 3, "drops-rows", "keeps the first four staged rows"},
    {M::kEditKeepsCrc, 18, "edit-keeps-crc", "keeps sequence and crc at an edit at the panel"},
    {M::kEditClearsCrcOnly, 18, "edit-clears-crc-only",
     "sets the crc to 0 at an edit at the panel, and keeps the sequence"},
    {M::kSwapsWords, 3, "swaps-words", "has the words of 32-bit values the other way round"},
    {M::kSwapsBytes, 3, "swaps-bytes", "has the bytes of each register the other way round"},
    {M::kSequence15Bits, 6, "sequence-15-bits", "keeps the low 15 bits of sequence numbers"},
    {M::kRefusesSmallerSequence, 12, "refuses-smaller-sequence",
     "rejects a sequence below the active one"},
    {M::kActivatesOnStaging, 4, "activates-on-staging", "takes a program as soon as it is staged"},
};

}  // namespace

std::span<const RuleMutantFacts> RuleMutants() { return kMutants; }

std::optional<RuleMutant> FindRuleMutant(std::string_view name) {
  for (const RuleMutantFacts& facts : kMutants) {
    if (facts.name == name) return facts.mutant;
  }
  return std::nullopt;
}

std::string RuleMutantHelp() {
  std::string help;
  for (const RuleMutantFacts& facts : kMutants) {
    char head[64];
    std::snprintf(head, sizeof head, "  R%-3d %-27s ", facts.rule, std::string(facts.name).c_str());
    help += head + std::string(facts.sentence) + "\n";
  }
  return help;
}

}  // namespace bendloop::drivers
