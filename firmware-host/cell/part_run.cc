// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/part_run.h"

#include <utility>

#include "firmware-host/cell/version.h"

namespace bendloop::host {
namespace {

// The correction of a part whose direction is settled; a program of another shape than the nominal
// gives a correction that only refuses.
pipeline::Correction CorrectPart(const PartPlan& plan, const RunContext& base,
                                 const pipeline::Inspection& inspection) {
  const hal::BendProgram& commanded = base.bent_with->program;
  const pipeline::LotState lot =
      base.lot ? *base.lot : pipeline::StartLot(plan.nominal, commanded, plan.correction);
  auto correction =
      pipeline::Correct({plan.nominal, commanded, inspection.measured.program, inspection.sigma},
                        lot, plan.correction);
  if (correction) return std::move(*correction);
  pipeline::Correction refused;
  refused.corrected = commanded;
  refused.next = lot;
  refused.refusals.push_back(correction.error().message);
  return refused;
}

pipeline::InterlockInput InterlockFacts(const PartPlan& plan, const ScanFacts& scan,
                                        const RunContext& base, const RunResult& result) {
  pipeline::InterlockInput input;
  input.nominal_bends = plan.nominal.bend_count();
  input.direction = result.inspection->direction;
  input.measured = result.inspection->measured.program;
  input.sigma = result.inspection->sigma;
  input.coverage = result.measurement.coverage;
  input.longest_gap_mm = result.measurement.longest_gap_mm;
  input.fit = result.measurement.fit;
  input.pipe_radius_mm = result.measurement.tube.pipe_radius_mm;
  input.nominal_pipe_radius_mm = plan.pipe_radius_mm;
  input.profiles = scan.profiles;
  input.profiles_lost = scan.lost_profiles;
  // Only an age beyond the limit counts, so that a replay gives the same bytes as the live run.
  if (scan.age_s > plan.interlocks.oldest_session_s) input.session_age_s = scan.age_s;
  input.correction = result.correction;
  if (base.bent_with) input.bent_with = *base.bent_with;
  return input;
}

PartEnd EndOf(CommitOutcome outcome) {
  switch (outcome) {
    case CommitOutcome::kCommitted:
      return PartEnd::kCorrected;
    case CommitOutcome::kRefused:
      return PartEnd::kRefused;
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

}  // namespace

bool PartOutcome::out_of_tolerance() const {
  return result.inspection && result.inspection->verdict == pipeline::Verdict::kFail;
}

int PartOutcome::exit_code() const {
  if (end == PartEnd::kLinkDown) return hal::ExitCode(hal::ErrorKind::kDevice);
  if (end == PartEnd::kRefused || out_of_tolerance()) {
    return hal::ExitCode(hal::ErrorKind::kRefused);
  }
  return 0;
}

PartOutcome DecidePart(const PartPlan& plan, const ScanIdentity& identity, const ScanFacts& scan,
                       const RunContext& base, pipeline::Measurement measurement,
                       BenderDesk& desk) {
  PartOutcome outcome;
  RunResult& result = outcome.result;
  result.part = plan.part;
  result.session = identity.session;
  result.time = identity.start;
  result.software = kSoftware;
  result.measurement = std::move(measurement);
  result.nominal = plan.nominal;
  result.inspection =
      pipeline::Inspect(result.measurement, plan.nominal, plan.pipe_radius_mm, plan.inspection);
  const bool sends = plan.corrects && desk.has_bender();
  if (plan.corrects && base.bent_with) {
    result.commanded = base.bent_with;
    if (result.inspection->direction.settled()) {
      result.correction = CorrectPart(plan, base, *result.inspection);
      outcome.next = result.correction->next;
    }
  }

  pipeline::InterlockInput input = InterlockFacts(plan, scan, base, result);
  input.sends = sends;
  BenderReading now;
  if (sends) {
    now = desk.Read();
    input.bender = now.facts;
    input.session_used = desk.SessionCommitted(identity.session);
  }
  result.interlocks = pipeline::CheckInterlocks(input, plan.interlocks);

  if (!result.interlocks->passed()) {
    outcome.end = PartEnd::kRefused;
    outcome.reasons = result.interlocks->refusals();
    if (sends) {
      result.bender = NothingSent(now, outcome.reasons);
      outcome.end = EndOf(result.bender->outcome);
    }
    // A lost link comes first: most of the interlocks only say what is not known without it.
    if (outcome.end == PartEnd::kLinkDown) {
      outcome.reasons.insert(outcome.reasons.begin(), result.bender->reason);
    }
    outcome.next.reset();
  } else if (sends && result.correction && result.correction->changes_anything) {
    result.bender = desk.Commit({identity.session, *base.bent_with, result.correction->corrected});
    outcome.end = EndOf(result.bender->outcome);
    if (outcome.end != PartEnd::kCorrected) outcome.reasons.push_back(result.bender->reason);
  }
  // Of a part that is undecided, too: its exit code is 0, so that somebody must say it.
  if (result.inspection->verdict != pipeline::Verdict::kPass) {
    outcome.reasons.insert(outcome.reasons.end(), result.inspection->reasons.begin(),
                           result.inspection->reasons.end());
  }
  return outcome;
}

}  // namespace bendloop::host
