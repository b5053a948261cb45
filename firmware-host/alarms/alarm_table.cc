// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/alarms/alarm_table.h"

#include <algorithm>

namespace bendloop::host {
namespace {

using enum AlarmCode;
using enum AlarmSeverity;

constexpr AlarmEnd kCause = AlarmEnd::kCause;
constexpr AlarmEnd kNext = AlarmEnd::kNextPart;
constexpr AlarmEnd kAck = AlarmEnd::kAcknowledged;

constexpr AlarmKind kTable[] = {
    {kScannerAway, kFault, kCause, "the scanner cannot be reached",
     "check its supply and cable, and [scanner] in the cell file; it is tried again by itself"},
    {kScannerSilent, kWarning, kNext, "the scanner fell silent in the middle of a scan",
     "check its cable; scan again if nothing more comes"},
    {kScanBroken, kWarning, kNext, "a scan broke off and is worth nothing", "scan the tube again"},
    {kProfilesLost, kWarning, kNext, "profiles of a scan were lost",
     "if it comes again: check the network, the USB port, and the load of this machine"},
    {kScannerRemarks, kNotice, kNext, "the scanner had troubles that it got over",
     "look at the detail; check cable and supply if it comes again"},

    {kNotMeasured, kWarning, kNext, "a scan showed no tube that can be measured",
     "scan the whole tube again, from more sides"},
    {kBendCount, kWarning, kNext, "held: the tube has another number of bends than the part",
     "check that the right tube was scanned, and all of it"},
    {kDirection, kWarning, kNext, "held: which end of the tube is which is not certain",
     "set [scan] direction, or scan again"},
    {kCoverage, kWarning, kNext, "held: too little of the tube was seen",
     "scan what is missing, from more sides"},
    {kGap, kWarning, kNext, "held: a piece of the tube was not seen", "scan it, too"},
    {kFit, kWarning, kNext, "held: the samples lie too far from the tube found",
     "check the scanner's calibration and what else is in its view"},
    {kPipeRadius, kWarning, kNext, "held: the tube has another diameter than the part",
     "check tube and part file"},
    {kLostProfiles, kWarning, kNext, "held: too many profiles of the scan were lost",
     "scan again; check the scanner's connection"},
    {kUncertainLength, kWarning, kNext, "held: no length is known well enough",
     "scan again with more lines on the straights"},
    {kUncertainRotation, kWarning, kNext, "held: no rotation is known well enough",
     "scan again from more sides"},
    {kUncertainAngle, kWarning, kNext, "held: no angle is known well enough",
     "scan again with more lines on the straights"},
    {kTubeMoved, kWarning, kNext, "held: the tube was moved between two passes of its scan",
     "lay it so that it stays where it is, and scan it again; if it comes again: check the arm"},
    {kOutOfTolerance, kNotice, kNext, "the last tube is out of tolerance",
     "put it aside; the correction follows by itself unless another alarm holds it"},
    {kUndecided, kNotice, kNext, "whether the last tube is in tolerance cannot be told",
     "scan it again with more lines, or measure it by hand"},
    {kMeasurementDoubts, kNotice, kNext, "the measurement has something to remark",
     "look at the detail and at the report"},

    {kCorrectionRefused, kWarning, kNext, "held: there is no correction that may be sent",
     "look at the detail; check tube, die, clamp and nominal"},
    {kCorrectionDiverges, kFault, kNext,
     "held: corrections have led too far from the lot's first program",
     "something else has changed: check tube, die, clamp and nominal, then begin a new lot"},
    {kStaleScan, kWarning, kNext, "held: the scan is too old to be acted on", "scan the next tube"},
    {kUsedScan, kWarning, kNext, "held: this scan has led to a program before",
     "bend and scan the next tube"},
    {kNoNewTube, kWarning, kNext, "held: no new tube was bent before this scan",
     "bend and scan the next one, or set [scan] parts_between"},
    {kTubeCount, kWarning, kNext, "held: the bender's count of tubes does not add up",
     "bend and scan a new tube"},
    {kTubeProgram, kWarning, kNext, "held: which program bent the tube is not certain",
     "bend and scan another tube"},
    {kTubeIdentity, kWarning, kNext, "held: it is another tube than the expected one",
     "scan the tubes in the order in which they were bent"},
    {kOtherPartsTube, kWarning, kNext, "held: the tube was bent by another part's program",
     "load the part's program at the bender, or set the right part"},
    {kLotHeld, kNotice, kCause, "the lot is held: it is learnt from, and no program is changed",
     "'bendloop lot release' when corrections shall go on"},
    {kTubeSlipped, kNotice, kNext, "a tube lies far off what its lot predicts",
     "nothing, if it slipped; a new coil or tool is announced with 'bendloop lot new'"},
    {kLotJumped, kNotice, kNext, "the tube before told of a slip, or of a jump that is followed",
     "nothing; look for its cause if it comes again"},
    {kRowHeld, kNotice, kNext, "some values are held because they are not known well enough",
     "nothing, if their next parts decide; scan with more lines there"},
    {kStepCut, kNotice, kNext, "a change was cut to the limit of one step",
     "nothing: the rest follows with the next parts"},
    {kLotRemoved, kNotice, kNext, "lot.json was removed: a new lot begins", "nothing"},
    {kCorrectionsOff, kWarning, kCause, "corrections are off though the cell file asks for them",
     "as the detail says"},
    {kCorrectionWaits, kNotice, kNext, "a correction waits for the bender",
     "nothing; let the bender come to rest between two tubes"},

    {kBenderAway, kFault, kCause, "the bender does not answer",
     "check that the controller runs, the cable, and [bender] in the cell file"},
    {kRulesBroken, kFault, kAck,
     "the bender broke the rules of the commit: corrections are locked until acknowledged",
     "look at the program that the bender holds, then acknowledge: after a power cut it may be "
     "bendloop's own, whose sending the disk lost; else mend the PLC's program ('bendloop "
     "acceptance' names the rule)"},
    {kBenderFault, kWarning, kCause, "the bender reports a fault", "see the bender's own panel"},
    {kBenderNotReady, kWarning, kNext, "held: the bender was not ready for a program",
     "make it ready; give it time between two tubes"},
    {kOtherPartLoaded, kWarning, kCause, "the bender holds the program of another part",
     "load the right part's program at the bender, or set the right part"},
    {kOtherProgramActive, kWarning, kNext,
     "held: the bender holds another program than the one that bent the tube",
     "bend and scan a tube of the program that is active now"},
    {kCommitRefused, kWarning, kNext, "a corrected program was refused; the old one is active",
     "the detail says by whom and why; look up the bender's reply code"},
    {kCommitFailed, kWarning, kNext, "a corrected program did not reach the bender",
     "check the link; the old program is active"},
    {kCommitUnknown, kFault, kCause, "which program the bender holds is not known yet",
     "make it answer: the first look settles it"},
    {kUnknownPart, kFault, kCause, "the PLC set a part number that no part file has",
     "add its file to parts_dir, or set a number that is there"},
    {kAmbiguousPart, kFault, kCause, "the PLC set a part number that two part files have",
     "leave one file with that number in parts_dir"},
    {kBlockNotTaken, kWarning, kCause, "the PLC does not take what is written for it",
     "compare [report] of the register map with the PLC; it is tried again by itself"},
    {kHeldByPlc, kNotice, kCause, "the PLC holds the cell: tubes are measured, none is corrected",
     "nothing; the PLC takes its hold back"},
    {kIdentityUnreadable, kWarning, kCause, "the tube's identity is no printable ASCII text",
     "compare orders.identity of the register map with the PLC's order of bytes"},
    {kScanHeld, kWarning, kNext, "a scan was recorded and nothing is made of it",
     "let the PLC set a part that is known, and say that a scan may run, before it begins"},

    {kResultNotKept, kFault, kCause, "a result could not be written",
     "check the disk of the state directory and its rights"},
    {kHistoryNotKept, kWarning, kCause, "the history could not be written",
     "check the disk of the state directory and its rights"},
    {kLotNotKept, kWarning, kCause, "what the lot has learnt could not be written",
     "check the disk of the state directory and its rights"},
    {kReportNotWritten, kNotice, kCause, "the report could not be written",
     "check the disk of the state directory and its rights"},
    {kRecordingIncomplete, kWarning, kNext, "a recording is incomplete, or was left out",
     "give the recordings a quicker disk; measurements are whole"},
    {kDiskFull, kFault, kCause, "the disk of the recordings is nearly full",
     "remove what is not needed, or lower [record] disk_budget_mb"},
    {kNoRealtime, kNotice, kCause, "real-time priority is not granted",
     "'bendloop doctor' says how to grant it"},
    {kSettingsRemark, kWarning, kCause, "a setting has no effect, or may do harm",
     "as the detail says"},
    {kUncleanEnd, kNotice, kNext, "the last run left a correction open; it is settled",
     "nothing; look why it ended if nobody stopped it"},
    {kHistoryDamaged, kWarning, kAck,
     "the history was damaged: it was moved aside, a new one begins",
     "check the disk; keep the file of the detail, it may be read in part, then acknowledge"},
    {kJournalDamaged, kFault, kAck,
     "the commit journal was damaged: corrections are locked until acknowledged",
     "check the disk; look at the program that the bender holds, then acknowledge"},
    {kJournalNotKept, kFault, kCause, "the commit journal cannot be written: nothing is corrected",
     "check the disk of the state directory and its rights; it is tried again by itself"},
    {kReloadRefused, kWarning, kCause,
     "the changed settings were refused: the cell goes on with the old ones",
     "mend the file as the detail says, then 'systemctl reload bendloopd'"},
    {kClockStepped, kNotice, kNext, "the clock of this machine was set by more than a minute",
     "nothing, if somebody set it; check its battery and its time server if it comes again"},
    {kOutOfMemory, kWarning, kNext, "something was left off for want of memory",
     "see what else runs on this machine and takes its memory; scan again what was not measured"},
    {kProcessorsTaken, kNotice, kCause, "other work takes this machine's processors",
     "nothing, while no profiles are lost (BL1004); see what else runs here ('top')"},
    {kMachineSwaps, kWarning, kCause, "this machine swaps: its memory is short",
     "see what else runs here and takes it ('ps aux --sort=-rss'); where some of it is this "
     "daemon's, 'bendloop doctor' says how to lock it"},
};

const char* Name(AlarmEnd end) {
  switch (end) {
    case AlarmEnd::kCause:
      return "its cause";
    case AlarmEnd::kNextPart:
      return "a part without it";
    case AlarmEnd::kAcknowledged:
      break;
  }
  return "acknowledged";
}

}  // namespace

const char* Name(AlarmSeverity severity) {
  switch (severity) {
    case kNotice:
      return "notice";
    case kWarning:
      return "warning";
    case kFault:
      break;
  }
  return "fault";
}

std::span<const AlarmKind> AlarmTable() { return kTable; }

const AlarmKind& KindOf(AlarmCode code) {
  return *std::lower_bound(std::begin(kTable), std::end(kTable), code,
                           [](const AlarmKind& kind, AlarmCode c) { return kind.code < c; });
}

std::string CodeText(AlarmCode code) { return "BL" + std::to_string(static_cast<unsigned>(code)); }

std::string AlarmTableMarkdown() {
  std::string text =
      "| code | severity | what | mend | ends with |\n| --- | --- | --- | --- | --- |\n";
  for (const AlarmKind& kind : kTable) {
    text += "| " + CodeText(kind.code) + " | " + Name(kind.severity) + " | " + kind.sentence +
            " | " + kind.mend + " | " + Name(kind.end) + " |\n";
  }
  return text;
}

}  // namespace bendloop::host
