// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/alarms/part_alarms.h"

#include <cstdint>

namespace bendloop::host {
namespace {

using pipeline::InterlockKind;

// "L2, A3": the values whose correction has the flag.
std::string Flagged(const pipeline::Correction& correction, std::uint32_t flag) {
  std::string names;
  const auto add = [&](const char* axis, std::size_t row, const pipeline::AxisCorrection& value) {
    if ((value.flags & flag) == 0) return;
    names += (names.empty() ? "" : ", ") + std::string(axis) + std::to_string(row + 1);
  };
  for (std::size_t i = 0; i < correction.rows.size(); ++i) {
    add("L", i, correction.rows[i].length_mm);
    add("R", i, correction.rows[i].rotation_deg);
    add("A", i, correction.rows[i].angle_deg);
  }
  return names;
}

// Of these nothing but the bender tells: that it is away is an alarm of its own.
bool IsToldByBender(InterlockKind kind) {
  return kind == InterlockKind::kBenderReady || kind == InterlockKind::kActiveProgram ||
         kind == InterlockKind::kNewTube || kind == InterlockKind::kTubeCount ||
         kind == InterlockKind::kTubeProgram || kind == InterlockKind::kCorrection;
}

class Complaints {
 public:
  explicit Complaints(const RunResult& result) : result_(result) {}

  RaisedAlarms All() {
    OfVerdict();
    OfInterlocks();
    if (result_.correction) OfCorrection(*result_.correction);
    if (result_.bender) OfBender(*result_.bender);
    std::string doubts;
    for (const std::string& warning : result_.measurement.warnings) {
      doubts += (doubts.empty() ? "" : "; ") + warning;
    }
    if (!doubts.empty()) Add(AlarmCode::kMeasurementDoubts, doubts);
    return std::move(alarms_);
  }

 private:
  // One alarm a code; what follows adds to it.
  void Add(AlarmCode code, const std::string& detail) {
    for (auto& [known, text] : alarms_) {
      if (known != code) continue;
      text += "; " + detail;
      return;
    }
    alarms_.emplace_back(code, result_.session + ": " + detail);
  }

  void OfVerdict() {
    if (!result_.inspection || result_.inspection->verdict == pipeline::Verdict::kPass) return;
    const bool is_out = result_.inspection->verdict == pipeline::Verdict::kFail;
    const std::vector<std::string>& reasons = result_.inspection->reasons;
    Add(is_out ? AlarmCode::kOutOfTolerance : AlarmCode::kUndecided,
        reasons.empty() ? pipeline::Name(result_.inspection->verdict).data() : reasons.front());
  }

  void OfInterlocks() {
    // A tube that is scanned once more has been decided of.
    if (!result_.interlocks || !result_.repeat_of.empty()) return;
    const auto& bender = result_.bender;
    const bool is_away =
        bender && bender->outcome == CommitOutcome::kFailed && !bender->active.has_value();
    const bool waits = bender && bender->outcome == CommitOutcome::kWaiting;
    if (waits) return;
    const pipeline::Interlock* follows = nullptr;
    std::size_t held = 0;
    for (const pipeline::Interlock& check : result_.interlocks->checks) {
      if (check.passed || (is_away && IsToldByBender(check.kind))) continue;
      // Not known for a reason that has an alarm of its own.
      if ((check.kind == InterlockKind::kCorrection && !result_.correction) ||
          (check.kind == InterlockKind::kActiveProgram && !result_.commanded)) {
        if (follows == nullptr) follows = &check;
        continue;
      }
      Add(AlarmOf(check.kind), check.sentence);
      ++held;
    }
    if (held == 0 && follows != nullptr) Add(AlarmOf(follows->kind), follows->sentence);
  }

  void OfCorrection(const pipeline::Correction& correction) {
    const auto add = [&](AlarmCode code, std::uint32_t flag) {
      if (const std::string names = Flagged(correction, flag); !names.empty()) Add(code, names);
    };
    add(AlarmCode::kCorrectionDiverges, pipeline::kFlagTotalLimit);
    add(AlarmCode::kStepCut, pipeline::kFlagStepLimit);
    add(AlarmCode::kRowHeld, pipeline::kFlagUncertain);
    if (correction.next.hypotheses.empty()) return;
    const pipeline::LotHypothesis& best = correction.next.hypotheses.front();
    if (best.event == pipeline::LotEvent::kNone) return;
    if (best.parts_since == 0) {
      const std::string names = Flagged(correction, pipeline::kFlagUnexpected);
      Add(AlarmCode::kTubeSlipped, names.empty() ? "the whole tube" : names);
    } else if (best.parts_since == 1) {
      Add(AlarmCode::kLotJumped, std::string(pipeline::Name(best.event)));
    }
  }

  void OfBender(const CommitReport& report) {
    switch (report.outcome) {
      case CommitOutcome::kCommitted:
        break;
      case CommitOutcome::kRefused:
        if (!result_.interlocks || result_.interlocks->passed()) {
          Add(AlarmCode::kCommitRefused, report.reason);
        }
        break;
      case CommitOutcome::kFailed:
        Add(AlarmCode::kCommitFailed, report.reason);
        break;
      case CommitOutcome::kUnknown:
        Add(AlarmCode::kCommitUnknown, report.reason);
        break;
      case CommitOutcome::kWaiting:
        Add(AlarmCode::kCorrectionWaits, report.reason);
        break;
    }
  }

  const RunResult& result_;
  RaisedAlarms alarms_;
};

}  // namespace

AlarmCode AlarmOf(InterlockKind kind) {
  switch (kind) {
    case InterlockKind::kBendCount:
      return AlarmCode::kBendCount;
    case InterlockKind::kDirection:
      return AlarmCode::kDirection;
    case InterlockKind::kCoverage:
      return AlarmCode::kCoverage;
    case InterlockKind::kGap:
      return AlarmCode::kGap;
    case InterlockKind::kFit:
      return AlarmCode::kFit;
    case InterlockKind::kPasses:
      return AlarmCode::kTubeMoved;
    case InterlockKind::kPipeRadius:
      return AlarmCode::kPipeRadius;
    case InterlockKind::kLostProfiles:
      return AlarmCode::kLostProfiles;
    case InterlockKind::kUncertaintyLength:
      return AlarmCode::kUncertainLength;
    case InterlockKind::kUncertaintyRotation:
      return AlarmCode::kUncertainRotation;
    case InterlockKind::kUncertaintyAngle:
      return AlarmCode::kUncertainAngle;
    case InterlockKind::kCorrection:
      return AlarmCode::kCorrectionRefused;
    case InterlockKind::kStaleSession:
      return AlarmCode::kStaleScan;
    case InterlockKind::kUsedSession:
      return AlarmCode::kUsedScan;
    case InterlockKind::kNewTube:
      return AlarmCode::kNoNewTube;
    case InterlockKind::kTubeCount:
      return AlarmCode::kTubeCount;
    case InterlockKind::kTubeProgram:
      return AlarmCode::kTubeProgram;
    case InterlockKind::kTubeIdentity:
      return AlarmCode::kTubeIdentity;
    case InterlockKind::kPartNumber:
      return AlarmCode::kOtherPartsTube;
    case InterlockKind::kBenderReady:
      return AlarmCode::kBenderNotReady;
    case InterlockKind::kActiveProgram:
      break;
  }
  return AlarmCode::kOtherProgramActive;
}

RaisedAlarms AlarmsOf(const RunResult& result) { return Complaints(result).All(); }

RaisedAlarms AlarmsOf(const std::string& session, const hal::Error& why) {
  AlarmCode code = AlarmCode::kNotMeasured;
  if (why.kind == hal::ErrorKind::kDevice) code = AlarmCode::kScanBroken;
  if (why.kind == hal::ErrorKind::kRefused) code = AlarmCode::kScanHeld;
  return {{code, session + ": " + why.message}};
}

}  // namespace bendloop::host
