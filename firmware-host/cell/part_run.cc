// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/part_run.h"

#include <algorithm>
#include <new>
#include <utility>

#include "firmware-host/console/version.h"
#include "firmware-host/ledger/tube_ledger.h"
#include "firmware-host/workers/want_of_memory.h"
#include "pipeline/correction/measured_covariance.h"

namespace bendloop::host {
namespace {

// The correction of a part whose direction is settled; a program of another shape than the nominal
// gives a correction that only refuses.
pipeline::Correction CorrectPart(const PartPlan& plan, const RunContext& base,
                                 const pipeline::Inspection& inspection,
                                 const pipeline::JointUncertainty& joint) {
  const hal::BendProgram& commanded = base.bent_with->program;
  const pipeline::LotState lot =
      base.lot ? *base.lot : pipeline::StartLot(plan.nominal, commanded, plan.correction);
  const hal::BendProgram& active = base.expected ? base.expected->program : commanded;
  pipeline::CorrectionInput input{plan.nominal, commanded, inspection.measured.program,
                                  inspection.sigma, active};
  input.correlations = joint.correlations;
  if (inspection.direction.state == pipeline::DirectionState::kReverse) {
    input.correlations =
        pipeline::ReversedCorrelations(joint.correlations, plan.nominal.bend_count());
  }
  input.ahead = 1 + plan.tubes_between;
  auto correction = pipeline::Correct(input, lot, plan.correction);
  if (correction) return std::move(*correction);
  pipeline::Correction refused;
  refused.corrected = active;
  refused.next = lot;
  refused.refusals.push_back(correction.error().message);
  return refused;
}

pipeline::InterlockInput InterlockFacts(const PartPlan& plan, const ScanFacts& scan, double age_s,
                                        const RunContext& base, const RunResult& result) {
  pipeline::InterlockInput input;
  input.nominal_bends = plan.nominal.bend_count();
  input.direction = result.inspection->direction;
  input.measured = result.inspection->measured.program;
  input.sigma = result.inspection->sigma;
  input.coverage = result.measurement.coverage;
  input.longest_gap_mm = result.measurement.longest_gap_mm;
  input.fit = result.measurement.fit;
  input.passes = result.measurement.passes;
  input.pipe_radius_mm = result.measurement.tube.pipe_radius_mm;
  input.nominal_pipe_radius_mm = plan.pipe_radius_mm;
  input.profiles = scan.profiles;
  input.profiles_lost = scan.lost_profiles;
  // Only an age beyond the limit counts, so that a replay gives the same bytes as the live run.
  if (age_s > plan.interlocks.oldest_session_s) input.session_age_s = age_s;
  input.correction = result.correction;
  if (base.bent_with) input.bent_with = *base.bent_with;
  input.expected = base.expected;
  input.part_number = plan.part_number;
  input.tube = base.tube_checks;
  return input;
}

PartEnd EndOf(CommitOutcome outcome) {
  switch (outcome) {
    case CommitOutcome::kCommitted:
      return PartEnd::kCorrected;
    case CommitOutcome::kRefused:
      return PartEnd::kRefused;
    case CommitOutcome::kWaiting:
      return PartEnd::kWaiting;
    case CommitOutcome::kFailed:
    case CommitOutcome::kUnknown:
      break;
  }
  return PartEnd::kLinkDown;
}

// What stands in the result where nothing was sent, with the reason.
CommitReport NothingSent(const BenderReading& now, const std::vector<std::string>& refusals) {
  CommitReport report;
  if (!now.facts) {
    report.outcome = CommitOutcome::kFailed;
    report.reason = now.problem +
                    "; nothing was sent: check that the controller runs, the cable, and [bender] "
                    "in the cell file";
    return report;
  }
  report.outcome = CommitOutcome::kRefused;
  report.reason = "nothing was sent: " + refusals.front();
  if (refusals.size() > 1) {
    report.reason += " (and " + std::to_string(refusals.size() - 1) + " more)";
  }
  report.active = now.facts->active;
  return report;
}

// What the ledger says of the tube, now that the bender has just been looked at.
TubeMatch FindTube(const MeasuredPart& part, const std::optional<TubeName>& name, BenderDesk& desk,
                   RunContext& base) {
  if (part.recorded) {
    base = *part.recorded;
    // Sent to a real bender, a recording is one more scan of a tube that the ledger knows.
    if (!part.scan.ended || !desk.counts_tubes()) return {};
    TubeMatch match = desk.MatchRecorded(part.identity.session, base.tube.value_or(0));
    base.tube_checks = match.checks;
    base.expected = match.expected;
    return match;
  }
  base.lot = part.lot;
  base.last_sequence = desk.LastSequence();
  TubeMatch match = desk.Match({part.identity.session, part.scan.began_ns, name});
  base.bent_with = match.bent_with;
  base.expected = match.expected;
  base.tube_checks = match.checks;
  base.tube = match.tube;
  base.repeat_of = match.repeats.value_or("");
  return match;
}

// Would it pass but for the moment: a bender that is busy, or that does not answer?
bool PassesButForTheMoment(const pipeline::InterlockReport& report, bool bender_answers) {
  using Kind = pipeline::InterlockKind;
  return std::all_of(report.checks.begin(), report.checks.end(), [&](const auto& check) {
    if (check.passed || check.kind == Kind::kBenderReady) return true;
    if (bender_answers) return false;
    // Told by the bender alone.
    return check.kind == Kind::kActiveProgram || check.kind == Kind::kCorrection ||
           check.kind == Kind::kNewTube || check.kind == Kind::kTubeCount ||
           check.kind == Kind::kTubeProgram;
  });
}

// One decision, from a measured part to what became of it.
class Decision {
 public:
  Decision(const PartPlan& plan, const MeasuredPart& part, BenderDesk& desk)
      : plan_(plan), part_(part), desk_(desk), result_(outcome_.result) {}

  PartOutcome Make() {
    Inspect();
    const bool passed = Check();
    const bool may_wait = sends_ && part_.may_wait &&
                          PassesButForTheMoment(*result_.interlocks, now_.facts.has_value());
    if (!passed && !may_wait) {
      Refuse();
    } else if (now_.facts && !UseTube()) {
      // `outcome_` says why.
    } else if (!passed) {
      Wait(now_.facts ? "nothing was sent yet: " + result_.interlocks->refusals().front()
                      : now_.problem + "; nothing was sent yet");
    } else if (sends_ && result_.correction && result_.correction->changes_anything) {
      Send();
    } else if (is_live_) {
      desk_.Note(part_.identity.session, ScanFate::kDone, "unchanged");
    }
    // Of a part that is undecided, too: its exit code is 0, so that somebody must say it.
    if (result_.inspection->verdict != pipeline::Verdict::kPass) {
      HasMemoryFor([this] {
        outcome_.reasons.insert(outcome_.reasons.end(), result_.inspection->reasons.begin(),
                                result_.inspection->reasons.end());
      });
    }
    return std::move(outcome_);
  }

 private:
  std::optional<TubeName> NameOfTube() const {
    if (part_.identity.tube.empty()) return std::nullopt;
    return TubeName{plan_.part_number, part_.identity.tube};
  }

  void Inspect() {
    result_.part = plan_.part;
    result_.session = part_.identity.session;
    result_.identity = part_.identity.tube;
    outcome_.part_number = plan_.part_number;
    result_.time = part_.identity.start;
    result_.software = kSoftware;
    result_.measurement = part_.measurement;
    outcome_.furthest_pass =
        pipeline::FurthestPass(part_.measurement.passes, plan_.reconstruction.pass_drift);
    result_.nominal = plan_.nominal;
    result_.inspection = pipeline::Inspect(result_.measurement, plan_.nominal, plan_.pipe_radius_mm,
                                           plan_.inspection);
  }

  bool Check() {
    RunContext& base = outcome_.context;
    sends_ = plan_.corrects && desk_.has_bender();
    is_live_ = sends_ && !desk_.read_only() && (!part_.recorded || part_.scan.ended);
    if (sends_) now_ = desk_.Look();
    if (plan_.corrects && (sends_ || part_.recorded))
      match_ = FindTube(part_, NameOfTube(), desk_, base);
    if (plan_.corrects && base.bent_with) {
      result_.commanded = base.bent_with;
      if (result_.inspection->direction.settled()) {
        result_.correction =
            CorrectPart(plan_, base, *result_.inspection, result_.measurement.joint);
        outcome_.next = result_.correction->next;
      }
    }
    const double age_s = part_.scan.ended ? SecondsBetween(*part_.scan.ended, desk_.Now()) : 0.0;
    pipeline::InterlockInput input = InterlockFacts(plan_, part_.scan, age_s, base, result_);
    input.sends = sends_;
    if (sends_) {
      input.bender = now_.facts;
      input.session_used = desk_.SessionCommitted(part_.identity.session);
    }
    result_.interlocks = pipeline::CheckInterlocks(input, plan_.interlocks);
    return result_.interlocks->passed();
  }

  void Refuse() {
    outcome_.end = PartEnd::kRefused;
    outcome_.reasons = result_.interlocks->refusals();
    if (sends_) {
      result_.bender = NothingSent(now_, outcome_.reasons);
      outcome_.end = EndOf(result_.bender->outcome);
    }
    // A lost link comes first: most of the interlocks only say what is not known without it.
    if (outcome_.end == PartEnd::kLinkDown) {
      outcome_.reasons.insert(outcome_.reasons.begin(), result_.bender->reason);
    }
    outcome_.next.reset();
    result_.repeat_of = outcome_.context.repeat_of;
    if (!result_.repeat_of.empty()) outcome_.end = PartEnd::kRepeat;
    if (!is_live_) return;
    if (outcome_.end == PartEnd::kRepeat) {
      desk_.Note(part_.identity.session, ScanFate::kDone, "repeat of " + result_.repeat_of);
      return;
    }
    if (match_.tube && !match_.passed()) {
      static_cast<void>(desk_.PassOver(part_.identity.session, match_, NameOfTube()));
    }
    desk_.Note(part_.identity.session, ScanFate::kHeld, outcome_.reasons.front());
  }

  // Before anything is learnt or sent: a crash from here on leaves a tube that is used up.
  bool UseTube() {
    if (!is_live_) return true;
    const auto used = desk_.Use(part_.identity.session, match_, NameOfTube());
    if (used) return true;
    outcome_.end = PartEnd::kRefused;
    outcome_.next.reset();
    CommitReport report;
    report.outcome = CommitOutcome::kRefused;
    report.reason = "nothing was sent: " + used.error().message;
    outcome_.reasons.push_back(report.reason);
    result_.bender = std::move(report);
    return false;
  }

  void Wait(const std::string& why) {
    CommitReport report;
    report.outcome = CommitOutcome::kWaiting;
    report.reason = why + "; it is tried again for " +
                    std::to_string(static_cast<int>(plan_.interlocks.oldest_session_s)) +
                    " s from the end of the scan";
    if (now_.facts) report.active = now_.facts->active;
    outcome_.end = PartEnd::kWaiting;
    outcome_.reasons.push_back(report.reason);
    if (!now_.facts) outcome_.next.reset();  // which program bent it is told by the bender
    result_.bender = std::move(report);
    desk_.Note(part_.identity.session, ScanFate::kWaiting, result_.bender->reason);
  }

  void Send() {
    const RunContext& base = outcome_.context;
    const hal::ProgramBlock& from = base.expected ? *base.expected : *base.bent_with;
    try {
      result_.bender = desk_.Commit({part_.identity.session, from, result_.correction->corrected});
    } catch (const std::bad_alloc&) {
      // It may have reached the bender. What was measured and learnt is kept, the desk tells how it
      // ended, and a part that waits is not decided again while it is on its way.
      if (!part_.may_wait) throw;
      return Wait(std::string("the commit was cut short: ") + kNoMemory);
    }
    if (result_.bender->may_be_repeated && part_.may_wait) return Wait(result_.bender->reason);
    outcome_.end = EndOf(result_.bender->outcome);
    // For the end itself that stands by now: what there is no memory to add is left off.
    HasMemoryFor([this] { TellSent(); });
  }

  void TellSent() {
    if (outcome_.end != PartEnd::kCorrected) outcome_.reasons.push_back(result_.bender->reason);
    if (!is_live_) return;
    ScanFate fate = ScanFate::kDone;
    if (result_.bender->outcome == CommitOutcome::kCommitted) fate = ScanFate::kCorrected;
    if (result_.bender->outcome == CommitOutcome::kUnknown) fate = ScanFate::kUnknown;
    desk_.Note(part_.identity.session, fate, result_.bender->reason);
  }

  const PartPlan& plan_;
  const MeasuredPart& part_;
  BenderDesk& desk_;
  PartOutcome outcome_;
  RunResult& result_;
  BenderReading now_;
  TubeMatch match_;
  bool sends_ = false;
  bool is_live_ = false;  // what is decided is kept in the ledger
};

}  // namespace

const char* Name(PartEnd end) {
  switch (end) {
    case PartEnd::kCorrected:
      return "corrected";
    case PartEnd::kUnchanged:
      return "unchanged";
    case PartEnd::kRefused:
      return "refused";
    case PartEnd::kWaiting:
      return "waiting";
    case PartEnd::kRepeat:
      return "repeat";
    case PartEnd::kLinkDown:
      break;
  }
  return "link down";
}

bool PartOutcome::out_of_tolerance() const {
  return result.inspection && result.inspection->verdict == pipeline::Verdict::kFail;
}

int PartOutcome::exit_code() const {
  if (end == PartEnd::kLinkDown) return hal::ExitCode(hal::ErrorKind::kDevice);
  if (end == PartEnd::kRefused || end == PartEnd::kRepeat || out_of_tolerance()) {
    return hal::ExitCode(hal::ErrorKind::kRefused);
  }
  return 0;
}

PartOutcome DecidePart(const PartPlan& plan, const MeasuredPart& part, BenderDesk& desk) {
  return Decision(plan, part, desk).Make();
}

void GiveUpWaiting(const std::string& why, PartOutcome& outcome, BenderDesk& desk) {
  CommitReport& report = *outcome.result.bender;
  report.outcome = CommitOutcome::kRefused;
  report.reason = "nothing was sent: " + why;
  outcome.end = PartEnd::kRefused;
  outcome.reasons = {report.reason};
  desk.Note(outcome.result.session, ScanFate::kDone, report.reason);
}

}  // namespace bendloop::host
