// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/plc_desk.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "firmware-host/daemon/state_store.h"

namespace bendloop::host {
namespace {

using pipeline::InterlockKind;

// A number from 0 to 4294967295; a deviation without bound is the largest.
constexpr double kMostPercent = 4294967295.0;

// These say that the judgement is of another tube, or of too little of it. The others only hold the
// correction.
bool SpoilsVerdict(InterlockKind kind) {
  switch (kind) {
    case InterlockKind::kBendCount:
    case InterlockKind::kDirection:
    case InterlockKind::kCoverage:
    case InterlockKind::kGap:
    case InterlockKind::kFit:
    case InterlockKind::kPasses:
    case InterlockKind::kPipeRadius:
    case InterlockKind::kLostProfiles:
    case InterlockKind::kTubeIdentity:
    case InterlockKind::kPartNumber:
      return true;
    default:
      return false;
  }
}

double Percent(const pipeline::Deviation& value) {
  if (!value.tolerance || value.state == pipeline::ToleranceState::kNotJudged) return 0;
  const double percent = 100 * std::abs(value.deviation) / *value.tolerance;
  return std::isnan(percent) ? kMostPercent : percent;
}

}  // namespace

hal::TubeVerdict VerdictOf(const RunResult& result) {
  if (!result.inspection) return hal::TubeVerdict::kHeld;
  if (result.interlocks) {
    for (const pipeline::Interlock& check : result.interlocks->checks) {
      if (!check.passed && SpoilsVerdict(check.kind)) return hal::TubeVerdict::kHeld;
    }
  }
  switch (result.inspection->verdict) {
    case pipeline::Verdict::kPass:
      return hal::TubeVerdict::kPass;
    case pipeline::Verdict::kFail:
      return hal::TubeVerdict::kFail;
    case pipeline::Verdict::kUndecided:
      break;
  }
  return hal::TubeVerdict::kUndecided;
}

std::uint32_t WorstPercent(const RunResult& result) {
  double worst = 0;
  if (!result.inspection) return 0;
  for (const pipeline::RowInspection& row : result.inspection->rows) {
    worst = std::max(
        {worst, Percent(row.length_mm), Percent(row.rotation_deg), Percent(row.angle_deg)});
  }
  return static_cast<std::uint32_t>(std::min(std::ceil(worst), kMostPercent));
}

bool PlcDesk::Heard(const hal::PlcOrders& orders) {
  const std::lock_guard lock(mutex_);
  const std::uint32_t asked = orders.acknowledge.value_or(0);
  const bool asks = has_heard_ && asked != 0 && asked != report_.acknowledged;
  if (!has_heard_) {
    // What stands there from before asks for nothing.
    report_.acknowledged = asked;
    report_.lot_begun = orders.new_lot.value_or(0);
  }
  if (asked == 0) report_.acknowledged = 0;
  if (orders.new_lot.value_or(0) == 0) report_.lot_begun = 0;
  has_heard_ = true;
  orders_ = orders;
  alarms_.Set(AlarmCode::kHeldByPlc, orders.hold.value_or(false));
  alarms_.Set(AlarmCode::kIdentityUnreadable, !orders.identity_is_text);
  return asks;
}

void PlcDesk::Acknowledged() {
  const std::lock_guard lock(mutex_);
  report_.acknowledged = orders_.acknowledge.value_or(0);
}

bool PlcDesk::holds() const {
  const std::lock_guard lock(mutex_);
  return orders_.hold.value_or(false);
}

bool PlcDesk::AsksForLot() const {
  const std::lock_guard lock(mutex_);
  const std::uint32_t asked = orders_.new_lot.value_or(0);
  return has_heard_ && asked != 0 && asked != report_.lot_begun;
}

void PlcDesk::LotBegun() {
  const std::lock_guard lock(mutex_);
  report_.lot_begun = orders_.new_lot.value_or(0);
}

void PlcDesk::Count(const std::string& session, hal::TubeVerdict verdict) {
  report_.sequence = NumberInName(session);
  report_.verdict = verdict;
  if (counted_ == session) return;  // it waited, and comes again
  counted_ = session;
  ++report_.tubes;
  if (verdict == hal::TubeVerdict::kPass) ++report_.passed;
  if (verdict == hal::TubeVerdict::kFail) ++report_.failed;
  if (verdict == hal::TubeVerdict::kUndecided) ++report_.undecided;
  if (verdict == hal::TubeVerdict::kHeld) ++report_.held;
}

void PlcDesk::Done(const PartOutcome& outcome) {
  const RunResult& result = outcome.result;
  const std::lock_guard lock(mutex_);
  // A part that waited and was overtaken is not the last one.
  if (NumberInName(result.session) < report_.sequence) return;
  if (outcome.end == PartEnd::kRepeat) counted_ = result.session;  // its tube was
  Count(result.session, VerdictOf(result));
  report_.part_number = outcome.part_number;
  report_.identity = result.identity;
  report_.worst_percent = WorstPercent(result);
}

void PlcDesk::Failed(const FailedScan& failed, std::uint32_t part_number) {
  const std::lock_guard lock(mutex_);
  Count(failed.identity.session, hal::TubeVerdict::kHeld);
  report_.part_number = part_number;
  report_.identity = failed.identity.tube;
  report_.worst_percent = 0;
}

hal::CellReport PlcDesk::Report(CellPhase phase, std::uint32_t part_set, bool is_held) const {
  // A notice is nothing to a PLC.
  std::vector<Alarm> active = alarms_.Active();
  std::erase_if(active, [](const Alarm& alarm) {
    return KindOf(alarm.code).severity == AlarmSeverity::kNotice;
  });
  const std::lock_guard lock(mutex_);
  hal::CellReport report = report_;
  report.part_set = part_set;
  report.alarms = static_cast<std::uint32_t>(active.size());
  report.alarm = active.empty() ? 0 : static_cast<std::uint32_t>(active.front().code);
  switch (phase) {
    case CellPhase::kStarting:
    case CellPhase::kStopping:
      report.state = hal::CellState::kStarting;
      return report;
    case CellPhase::kScanning:
      report.state = hal::CellState::kScanning;
      return report;
    case CellPhase::kDeciding:
      report.state = hal::CellState::kMeasuring;
      return report;
    case CellPhase::kCommitting:
      report.state = hal::CellState::kCommitting;
      return report;
    case CellPhase::kNoScanner:
    case CellPhase::kWaiting:
      break;
  }
  const bool is_fault =
      !active.empty() && KindOf(active.front().code).severity == AlarmSeverity::kFault;
  report.state = is_fault  ? hal::CellState::kFault
                 : is_held ? hal::CellState::kHeld
                           : hal::CellState::kIdle;
  return report;
}

}  // namespace bendloop::host
