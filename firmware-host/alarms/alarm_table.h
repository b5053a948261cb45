// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace bendloop::host {

// What a cell may complain of. The numbers are public (log, status, metrics, history, the PLC's
// register): one that is given is never given to anything else. 1xxx scanner, 2xxx measurement,
// 3xxx correction, 4xxx bender and PLC, 5xxx storage and system.
enum class AlarmCode : std::uint16_t {
  kScannerAway = 1001,
  kScannerSilent = 1002,
  kScanBroken = 1003,
  kProfilesLost = 1004,
  kScannerRemarks = 1005,

  kNotMeasured = 2001,
  kBendCount = 2002,
  kDirection = 2003,
  kCoverage = 2004,
  kGap = 2005,
  kFit = 2006,
  kPipeRadius = 2007,
  kLostProfiles = 2008,
  kUncertainLength = 2009,
  kUncertainRotation = 2010,
  kUncertainAngle = 2011,
  kTubeMoved = 2012,
  kOutOfTolerance = 2020,
  kUndecided = 2021,
  kMeasurementDoubts = 2022,

  kCorrectionRefused = 3001,
  kCorrectionDiverges = 3002,
  kStaleScan = 3003,
  kUsedScan = 3004,
  kNoNewTube = 3005,
  kTubeCount = 3006,
  kTubeProgram = 3007,
  kTubeIdentity = 3008,
  kOtherPartsTube = 3009,
  kLotHeld = 3010,
  kTubeSlipped = 3011,
  kLotJumped = 3012,
  kRowHeld = 3013,
  kStepCut = 3014,
  kLotRemoved = 3015,
  kCorrectionsOff = 3016,
  kCorrectionWaits = 3017,

  kBenderAway = 4001,
  kRulesBroken = 4002,
  kBenderFault = 4003,
  kBenderNotReady = 4004,
  kOtherPartLoaded = 4005,
  kOtherProgramActive = 4006,
  kCommitRefused = 4007,
  kCommitFailed = 4008,
  kCommitUnknown = 4009,
  kUnknownPart = 4010,
  kAmbiguousPart = 4011,
  kBlockNotTaken = 4013,
  kHeldByPlc = 4014,
  kIdentityUnreadable = 4015,
  kScanHeld = 4016,

  kResultNotKept = 5001,
  kHistoryNotKept = 5002,
  kLotNotKept = 5003,
  kReportNotWritten = 5004,
  kRecordingIncomplete = 5005,
  kDiskFull = 5006,
  kNoRealtime = 5007,
  kSettingsRemark = 5008,
  kUncleanEnd = 5009,
  kHistoryDamaged = 5010,
  kJournalDamaged = 5011,
  kJournalNotKept = 5012,
  kReloadRefused = 5013,
  kClockStepped = 5014,
  kOutOfMemory = 5015,
  kProcessorsTaken = 5016,
  kMachineSwaps = 5017,
};

enum class AlarmSeverity : std::uint8_t {
  kNotice,   // nothing has to be done
  kWarning,  // work goes on, and somebody should look
  kFault,    // nothing is measured, or nothing is corrected, until it is mended
};
const char* Name(AlarmSeverity severity);  // "notice", "warning", "fault"

// How an alarm ends.
enum class AlarmEnd : std::uint8_t {
  kCause,        // when its cause is gone
  kNextPart,     // with the next part that has it not, or when it is acknowledged
  kAcknowledged  // when it is acknowledged, and not before
};

struct AlarmKind {
  AlarmCode code;
  AlarmSeverity severity;
  AlarmEnd end;
  const char* sentence;  // what is the matter, whatever the case
  const char* mend;
};

// All of them, by their numbers: the one place that says what they mean.
std::span<const AlarmKind> AlarmTable();
const AlarmKind& KindOf(AlarmCode code);
// "BL1001".
std::string CodeText(AlarmCode code);
// As in README.md.
std::string AlarmTableMarkdown();

}  // namespace bendloop::host
