// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/cell_alarms.h"

#include <spdlog/spdlog.h>

#include <algorithm>

#include "firmware-host/alarms/alarm_text.h"
#include "firmware-host/ledger/moment.h"
#include "firmware-host/retention/free_space.h"

namespace bendloop::host {
namespace {

// That wait for the history while a scan runs or its disk hangs.
constexpr std::size_t kMostNews = 256;
// A scan of some minutes takes as much.
constexpr std::uint64_t kLeastFreeMb = 256;

void Log(const Alarm& alarm) {
  auto level = spdlog::level::info;
  if (alarm.is_active() && KindOf(alarm.code).severity == AlarmSeverity::kWarning) {
    level = spdlog::level::warn;
  }
  if (alarm.is_active() && KindOf(alarm.code).severity == AlarmSeverity::kFault) {
    level = spdlog::level::err;
  }
  spdlog::log(level, "{}", LogLine(alarm));
}

std::string Times(std::uint64_t count, const char* what) {
  return std::to_string(count) + " " + what + (count == 1 ? "" : "s");
}

}  // namespace

CellAlarms::CellAlarms()
    : board_([] { return SystemMoment().unix_ms; },
             [this](const Alarm& alarm) {
               Log(alarm);
               const std::lock_guard lock(mutex_);
               news_.push_back(alarm);
               if (news_.size() > kMostNews) news_.pop_front();
             }) {}

std::vector<Alarm> CellAlarms::TakeNews() {
  const std::lock_guard lock(mutex_);
  std::vector<Alarm> news(news_.begin(), news_.end());
  news_.clear();
  return news;
}

void CellAlarms::BenderHeard(const BenderReading& heard, std::uint32_t part_number) {
  board_.Set(AlarmCode::kBenderAway, !heard.facts && !heard.is_journals, heard.problem);
  board_.Set(AlarmCode::kJournalNotKept, heard.is_journals, heard.problem);
  if (!heard.facts) return;
  const hal::BenderState& state = heard.facts->state;
  board_.Set(AlarmCode::kBenderFault, state.mode == hal::BenderMode::kFault,
             "fault code " + std::to_string(state.fault_code));
  const std::uint32_t loaded = heard.facts->active.part_number;
  board_.Set(AlarmCode::kOtherPartLoaded, loaded != part_number,
             "its program is of part " + std::to_string(loaded) + ", set is " +
                 std::to_string(part_number));
}

RaisedAlarms CellAlarms::Rises(const CellSnapshot& cell, bool part_is_over) {
  RaisedAlarms rises;
  const std::lock_guard lock(mutex_);
  for (Rising& counter : rising_) {
    std::uint64_t now = 0;
    const char* what = "profile";
    if (counter.code == AlarmCode::kProfilesLost) {
      now = cell.dropped_profiles + cell.missing_profiles;
    } else if (counter.code == AlarmCode::kScannerSilent) {
      now = cell.silences;
      what = "time";
    } else if (counter.code == AlarmCode::kOutOfMemory) {
      now = cell.memory_wants;
      what = "time";
    } else {
      now = cell.recorder_dropped + cell.recorder_dropped_events + cell.recorder_dropped_sessions;
      what = "profile, event or scan";
    }
    // Those of the scanner begin anew when it is opened anew.
    counter.last = std::min(counter.last, now);
    if (now == counter.last) continue;
    std::string detail = Times(now - counter.last, what);
    if (counter.code == AlarmCode::kRecordingIncomplete && !cell.recorder_error.empty()) {
      detail += ", " + cell.recorder_error;
    }
    if (counter.code == AlarmCode::kOutOfMemory)
      detail += ", last: " + std::string(cell.memory_want);
    rises.emplace_back(counter.code, std::move(detail));
    if (part_is_over) counter.last = now;
  }
  return rises;
}

void CellAlarms::Look(const CellSnapshot& cell) {
  for (const auto& [code, detail] : Rises(cell, false)) board_.Begin(code, detail);
  LookAtDisk(cell);
}

void CellAlarms::LookAtDisk(const CellSnapshot& cell) {
  // By the recorder: when the first profiles of a recording are safe, when it ends, when it could
  // not begin, and every few seconds while there is nothing to be written.
  const bool lacks_names = cell.disk_free_names < kLeastFreeNames;
  std::string left = std::to_string(cell.disk_free_mb) + " MB";
  if (lacks_names) left += " and " + std::to_string(cell.disk_free_names) + " files (inodes)";
  board_.Set(AlarmCode::kDiskFull,
             cell.knows_disk && (lacks_names || cell.disk_free_mb < kLeastFreeMb),
             left + " are free");
}

void CellAlarms::PartDone(RaisedAlarms complaints, const CellSnapshot& cell) {
  for (auto& rise : Rises(cell, true)) complaints.push_back(std::move(rise));
  board_.SetOfPart(complaints);
  // Now: while a correction waits, as for a journal on a full disk, nobody calls Look.
  LookAtDisk(cell);
}

}  // namespace bendloop::host
