// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string_view>
#include <utility>

#include "firmware-host/commit/commit_protocol.h"
#include "pipeline/correction/correction.h"
#include "pipeline/correction/interlocks.h"
#include "pipeline/fit/correlations.h"
#include "pipeline/inspection/direction.h"
#include "pipeline/inspection/inspection.h"

namespace bendloop::host {

// The words of the JSON schema for each enumeration. They are public interface and live here, so
// that a sentence reworded elsewhere changes no file format.
template <class E>
struct Words;

template <>
struct Words<pipeline::Verdict> {
  using E = pipeline::Verdict;
  static constexpr const char* kExpected = "\"pass\", \"fail\" or \"undecided\"";
  static constexpr std::pair<E, std::string_view> kTable[] = {
      {E::kPass, "pass"}, {E::kFail, "fail"}, {E::kUndecided, "undecided"}};
};

template <>
struct Words<pipeline::OpeningState> {
  using E = pipeline::OpeningState;
  static constexpr const char* kExpected = "\"found\", \"missing\" or \"not_seen\"";
  static constexpr std::pair<E, std::string_view> kTable[] = {
      {E::kFound, "found"}, {E::kMissing, "missing"}, {E::kNotSeen, "not_seen"}};
};

template <>
struct Words<pipeline::OpeningKind> {
  using E = pipeline::OpeningKind;
  static constexpr const char* kExpected = "\"hole\", \"leaning_hole\" or \"slot\"";
  static constexpr std::pair<E, std::string_view> kTable[] = {
      {E::kHole, "hole"}, {E::kLeaningHole, "leaning_hole"}, {E::kSlot, "slot"}};
};

template <>
struct Words<pipeline::ToleranceState> {
  using E = pipeline::ToleranceState;
  static constexpr const char* kExpected = "\"in\", \"out\", \"undecided\" or \"not_judged\"";
  static constexpr std::pair<E, std::string_view> kTable[] = {{E::kIn, "in"},
                                                              {E::kOut, "out"},
                                                              {E::kUndecided, "undecided"},
                                                              {E::kNotJudged, "not_judged"}};
};

template <>
struct Words<pipeline::DirectionState> {
  using E = pipeline::DirectionState;
  static constexpr const char* kExpected =
      "\"forward\", \"reverse\", \"ambiguous\", \"wrong_bends\", \"mirrored\" or \"no_match\"";
  static constexpr std::pair<E, std::string_view> kTable[] = {
      {E::kForward, "forward"},        {E::kReverse, "reverse"},   {E::kAmbiguous, "ambiguous"},
      {E::kWrongBends, "wrong_bends"}, {E::kMirrored, "mirrored"}, {E::kNoMatch, "no_match"}};
};

template <>
struct Words<CommitOutcome> {
  using E = CommitOutcome;
  static constexpr const char* kExpected =
      "\"committed\", \"refused\", \"failed\", \"unknown\" or \"waiting\"";
  static constexpr std::pair<E, std::string_view> kTable[] = {{E::kCommitted, "committed"},
                                                              {E::kRefused, "refused"},
                                                              {E::kFailed, "failed"},
                                                              {E::kUnknown, "unknown"},
                                                              {E::kWaiting, "waiting"}};
};

template <>
struct Words<hal::CommitReply> {
  using E = hal::CommitReply;
  static constexpr const char* kExpected = "\"none\", \"accepted\" or \"rejected\"";
  static constexpr std::pair<E, std::string_view> kTable[] = {
      {E::kNone, "none"}, {E::kAccepted, "accepted"}, {E::kRejected, "rejected"}};
};

template <>
struct Words<ReadBack> {
  using E = ReadBack;
  static constexpr const char* kExpected =
      "\"not_read\", \"as_sent\", \"old\", \"spoiled\", \"void\" or \"other\"";
  static constexpr std::pair<E, std::string_view> kTable[] = {
      {E::kNotRead, "not_read"}, {E::kAsSent, "as_sent"}, {E::kOld, "old"},
      {E::kSpoiled, "spoiled"},  {E::kVoid, "void"},      {E::kOther, "other"}};
};

template <>
struct Words<pipeline::CorrectionFlag> {
  using E = pipeline::CorrectionFlag;
  static constexpr const char* kExpected = "a flag of a correction, such as \"deadband\"";
  static constexpr std::pair<E, std::string_view> kTable[] = {
      {E::kFlagDeadband, "deadband"},      {E::kFlagStepLimit, "step_limit"},
      {E::kFlagTotalLimit, "total_limit"}, {E::kFlagNotCorrected, "not_corrected"},
      {E::kFlagNoMeaning, "no_meaning"},   {E::kFlagImpossible, "impossible"},
      {E::kFlagAtZero, "at_zero"},         {E::kFlagUnexpected, "unexpected"},
      {E::kFlagUncertain, "uncertain"},    {E::kFlagLotHeld, "lot_held"}};
};

template <>
struct Words<pipeline::InterlockKind> {
  using E = pipeline::InterlockKind;
  static constexpr const char* kExpected = "the name of an interlock, such as \"coverage\"";
  static constexpr std::pair<E, std::string_view> kTable[] = {
      {E::kBendCount, "bend_count"},
      {E::kDirection, "direction"},
      {E::kCoverage, "coverage"},
      {E::kGap, "gap"},
      {E::kFit, "fit"},
      {E::kPasses, "passes"},
      {E::kPipeRadius, "pipe_radius"},
      {E::kLostProfiles, "lost_profiles"},
      {E::kUncertaintyLength, "uncertainty_length"},
      {E::kUncertaintyRotation, "uncertainty_rotation"},
      {E::kUncertaintyAngle, "uncertainty_angle"},
      {E::kCorrection, "correction"},
      {E::kStaleSession, "stale_session"},
      {E::kUsedSession, "used_session"},
      {E::kNewTube, "new_tube"},
      {E::kTubeCount, "tube_count"},
      {E::kTubeProgram, "tube_program"},
      {E::kTubeIdentity, "tube_identity"},
      {E::kPartNumber, "part_number"},
      {E::kBenderReady, "bender_ready"},
      {E::kActiveProgram, "active_program"}};
};

template <>
struct Words<pipeline::RowValueKind> {
  using E = pipeline::RowValueKind;
  static constexpr const char* kExpected =
      "\"length_mm\", \"rotation_deg\", \"angle_deg\" or \"bend_radius_mm\"";
  static constexpr std::pair<E, std::string_view> kTable[] = {{E::kLength, "length_mm"},
                                                              {E::kRotation, "rotation_deg"},
                                                              {E::kAngle, "angle_deg"},
                                                              {E::kBendRadius, "bend_radius_mm"}};
};

template <class E>
constexpr std::string_view Word(E value) {
  for (const auto& [known, word] : Words<E>::kTable) {
    if (known == value) return word;
  }
  return "unknown";
}

template <class E>
constexpr std::optional<E> FromWord(std::string_view text) {
  for (const auto& [known, word] : Words<E>::kTable) {
    if (word == text) return known;
  }
  return std::nullopt;
}

}  // namespace bendloop::host
