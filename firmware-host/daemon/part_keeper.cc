// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/part_keeper.h"

#include <spdlog/spdlog.h>

#include <utility>
#include <vector>

#include "drivers/sqlite/damaged_file.h"
#include "firmware-host/console/output_file.h"
#include "firmware-host/console/version.h"
#include "firmware-host/console/whole_file.h"
#include "firmware-host/daemon/lost_part.h"
#include "firmware-host/daemon/memory_guard.h"
#include "firmware-host/ledger/moment.h"
#include "firmware-host/report/report.h"
#include "firmware-host/result/json.h"
#include "firmware-host/result/result_json.h"
#include "firmware-host/retention/retention.h"
#include "firmware-host/text/result_text.h"
#include "pipeline/math/text.h"

namespace bendloop::host {
namespace {

// Parts that the report shows beside each other.
constexpr std::size_t kReportParts = 20;
// Who asked for what: some 10 000 requests, and as many of before.
constexpr std::uintmax_t kMostLogBytes = 1u << 20;
// Of each damaged database: who looks into them looks at the latest.
constexpr std::size_t kMostMovedAside = 5;
// Beginnings and ends of alarms that wait for a history that cannot be written; results of scans
// that failed.
constexpr std::size_t kMostOwed = 256;

// `passes part=part-0007 count=2 furthest=2 apart_mm=0.061 apart_deg=0.004 limit_mm=0.424
// limit_deg=0.170 moved_mm=0.031,0.030 turned_deg=0.002,0.002`: by what each pass of the scan was
// moved to meet the others, for who looks after the arm. "": they met.
std::string PassesLine(const PartOutcome& outcome) {
  const auto& furthest = outcome.furthest_pass;
  if (!furthest) return "";
  const auto& passes = outcome.result.measurement.passes;
  const auto of_each = [&passes](Eigen::Vector3d pipeline::PassOffset::*offset) {
    std::string text;
    for (const pipeline::PassOffset& pass : passes) {
      text += (text.empty() ? "" : ",") + pipeline::Fixed((pass.*offset).norm(), 3);
    }
    return text;
  };
  return "passes part=" + outcome.result.session + " count=" + std::to_string(passes.size()) +
         " furthest=" + std::to_string(furthest->number) +
         " apart_mm=" + pipeline::Fixed(furthest->moved_mm, 3) +
         " apart_deg=" + pipeline::Fixed(furthest->turned_deg, 3) +
         " limit_mm=" + pipeline::Fixed(furthest->limit_mm, 3) +
         " limit_deg=" + pipeline::Fixed(furthest->limit_deg, 3) +
         " moved_mm=" + of_each(&pipeline::PassOffset::move_mm) +
         " turned_deg=" + of_each(&pipeline::PassOffset::turn_deg);
}

}  // namespace

PartKeeper::PartKeeper(StateStore& store, const config::CellConfig& cell, const PartPlan& own,
                       AlarmBoard& alarms)
    : store_(store),
      sessions_(cell.record.directory),
      storage_(cell.storage),
      own_part_(own.part_number),
      alarms_(alarms) {}

hal::Result<void> PartKeeper::Load(const PartPlan& own) {
  const auto opened = OpenHistory();
  // Another program's file, or one of a newer version: not ours to put away. A disk's trouble may
  // pass.
  if (!opened && opened.error().kind == hal::ErrorKind::kBadInput) return opened;
  // Those of the last run, which nobody saw end.
  Note([](History& history) { return history.EndAlarms(SystemMoment().unix_ms); });
  return TakeUp(own);
}

hal::Result<void> PartKeeper::OpenHistory() {
  if (history_) return {};
  if (auto aside = SetDamagedHistoryAside(); !aside) return aside;
  auto history = History::Open(store_.history());
  if (!history) return hal::Fail(history.error());
  history_.emplace(std::move(*history));
  NameAfter(history_->LargestPartNumber().value_or(0));
  return {};
}

hal::Result<void> PartKeeper::SetDamagedHistoryAside() {
  const std::string damage = drivers::DamageOf(store_.history());
  if (damage.empty()) return {};
  const auto aside = drivers::MoveAside(store_.history(), SystemMoment().unix_ms);
  if (!aside) return hal::Fail(aside.error());
  is_anew_ = true;
  alarms_.Begin(AlarmCode::kHistoryDamaged, "it lies now in " + aside->string() + "; " + damage);
  return {};
}

bool PartKeeper::Note(const HistoryWork& work) {
  const auto attempt = [&] {
    return OrOutOfMemory("history", [&]() -> hal::Result<void> {
      if (auto opened = OpenHistory(); !opened) return opened;
      return work(*history_);
    });
  };
  hal::Result<void> done = attempt();
  if (!done && done.error().kind == hal::ErrorKind::kBadInput && history_) {
    history_.reset();  // the next attempt looks whether the file is damaged
    done = attempt();
  }
  Judge(AlarmCode::kHistoryNotKept, done);
  return done.has_value();
}

hal::Result<void> PartKeeper::TakeUp(const PartPlan& part) {
  if (lots_.count(part.part_number) > 0) return {};
  KeptLot kept{part.config_digest, LotFileOf(part.part_number, own_part_), {}};
  auto lot = store_.Lot(kept.key, kept.file);
  if (!lot) return hal::Fail(lot.error());
  kept.state = std::move(*lot);
  if (kept.state) {
    spdlog::info("part {}: its lot goes on, {} parts so far", part.part_number, kept.state->parts);
  }
  lots_.emplace(part.part_number, std::move(kept));
  return {};
}

std::optional<pipeline::LotState> PartKeeper::Lot(const PartPlan& part) {
  const auto lot = lots_.find(part.part_number);
  if (lot == lots_.end()) return std::nullopt;
  KeptLot& kept = lot->second;
  // What the disk has never taken nobody has removed.
  const bool is_owed = owed_lots_.count(part.part_number) > 0;
  if (kept.state && !is_owed && !store_.HasLot(kept.file)) {
    alarms_.Begin(AlarmCode::kLotRemoved,
                  "of part " + std::to_string(part.part_number) + " nothing is known");
    kept.state.reset();
  }
  return kept.state;
}

hal::Result<void> PartKeeper::SetLot(const PartPlan& part, const pipeline::LotState& lot) {
  KeptLot& kept = lots_[part.part_number];
  pipeline::LotState state = lot;  // before: for what is written there must be memory here, too
  if (auto written = store_.KeepLot(lot, kept.key, kept.file); !written) return written;
  kept.state = std::move(state);
  return {};
}

bool PartKeeper::DropOld(const std::set<std::string>& in_hand) {
  std::error_code error;
  const std::filesystem::path log = store_.requests_log();
  if (std::filesystem::file_size(log, error) > kMostLogBytes && !error) {
    std::filesystem::rename(log, log.string() + ".1", error);  // the one before goes
  }
  for (const auto& database : {store_.history(), store_.journal()}) {
    const auto aside = drivers::MovedAside(database);
    for (std::size_t i = 0; i + kMostMovedAside < aside.size(); ++i) {
      std::filesystem::remove(aside[i], error);
    }
  }
  if (storage_.max_age_days <= 0) return true;
  const auto pinned = PinnedNames(sessions_);
  if (!pinned) {
    spdlog::warn("{}", pinned.error().message);
    return false;
  }
  std::set<std::string> kept = *pinned;
  kept.insert(in_hand.begin(), in_hand.end());
  return Note([&](History& history) -> hal::Result<void> {
    history.Keep({kept.begin(), kept.end()});
    const auto dropped = history.DropOld(storage_.max_age_days, SystemMoment().unix_ms);
    if (!dropped) return hal::Fail(dropped.error());
    if (*dropped > 0) spdlog::info("history: {} old parts dropped", *dropped);
    return {};
  });
}

ScanIdentity PartKeeper::Identify() {
  last_number_ = std::max(last_number_, store_.LastNumber(sessions_)) + 1;
  return {PartName(last_number_), UtcText(SystemMoment().unix_ms), {}};
}

void PartKeeper::Judge(AlarmCode code, const hal::Result<void>& kept) {
  alarms_.Set(code, !kept, kept ? "" : kept.error().message);
}

void PartKeeper::KeepAlarms(const std::vector<Alarm>& news) {
  HasMemoryFor([&] { owed_alarms_.insert(owed_alarms_.end(), news.begin(), news.end()); });
  while (owed_alarms_.size() > kMostOwed) owed_alarms_.pop_front();
  // Else TryAgain does, which is not called as often.
  if (!alarms_.IsActive(AlarmCode::kHistoryNotKept)) NoteAlarms();
}

void PartKeeper::NoteAlarms() {
  while (!owed_alarms_.empty() &&
         Note([this](History& history) { return history.NoteAlarm(owed_alarms_.front()); })) {
    owed_alarms_.pop_front();
  }
}

void PartKeeper::Owe(const std::string& session, Owed owed) {
  if (!owed.result && !owed.history) {
    owed_.erase(session);
    return;
  }
  HasMemoryFor([&] { owed_[session] = std::move(owed); });
  if (owed_.size() > kMostOwed) owed_.erase(owed_.begin());
}

void PartKeeper::Pay(const std::string& session, const Owed& owed) {
  Owed left = owed;
  if (!owed.failure.empty()) {
    left.result = !WriteResult(session, [&] { return owed.failure; });
    return Owe(session, std::move(left));
  }
  const auto of_it = [&](const RunResult& result) { return result.session == session; };
  const auto result = std::find_if(recent_.begin(), recent_.end(), of_it);
  if (result == recent_.end()) return Owe(session, {});  // too long ago
  left.result = owed.result && !WriteResult(session, [&] { return WriteResultJson(*result); });
  left.history = owed.history && !NoteResult(*result, owed.part_number);
  Owe(session, std::move(left));
}

void PartKeeper::TryAgain() {
  HasMemoryFor([this] {
    for (const auto& [session, owed] : std::map(owed_)) Pay(session, owed);
    for (const std::uint32_t part_number : std::set(owed_lots_)) WriteLot(part_number);
  });
  NoteAlarms();
  if (alarms_.IsActive(AlarmCode::kReportNotWritten)) WriteReport();
}

bool PartKeeper::WriteResult(const std::string& session, const std::function<std::string()>& json) {
  const auto written = OrOutOfMemory(
      session, [&] { return WriteOutputFile(store_.results() / (session + ".json"), json()); });
  problem_ = written ? "" : "result not kept: " + written.error().message;
  Judge(AlarmCode::kResultNotKept, written);
  return written.has_value();
}

void PartKeeper::KeepResult(const RunResult& result, std::uint32_t part_number) {
  Owed owed{.part_number = part_number, .failure = ""};
  owed.result = !WriteResult(result.session, [&] { return WriteResultJson(result); });
  owed.history = !NoteResult(result, part_number);
  Owe(result.session, std::move(owed));
}

bool PartKeeper::NoteResult(const RunResult& result, std::uint32_t part_number) {
  const auto lot = lots_.find(part_number);
  std::optional<std::int64_t> number;
  if (lot != lots_.end() && lot->second.state) number = lot->second.state->number;
  return Note([&](History& history) { return history.AddOrReplace(result, number); });
}

bool PartKeeper::WriteLot(std::uint32_t part_number) {
  const KeptLot& kept = lots_[part_number];
  owed_lots_.erase(part_number);
  if (!kept.state) return true;  // its file was removed: a new lot begins
  const auto written =
      OrOutOfMemory("lot", [&] { return store_.KeepLot(*kept.state, kept.key, kept.file); });
  Judge(AlarmCode::kLotNotKept, written);
  if (!written) HasMemoryFor([&] { owed_lots_.insert(part_number); });
  return written.has_value();
}

void PartKeeper::Keep(PartOutcome outcome) {
  const RunResult& result = outcome.result;
  if (outcome.next) {
    KeptLot& kept = lots_[outcome.part_number];
    // Whether it is held a setter says; the PLC's hold is of the moment.
    outcome.next->held = kept.state && kept.state->held;
    kept.state = outcome.next;
    WriteLot(outcome.part_number);
  }
  KeepResult(result, outcome.part_number);
  std::string verdict = VerdictLine(result, false);
  while (!verdict.empty() && verdict.back() == '\n') verdict.pop_back();
  spdlog::info("{}: {}", result.session, verdict);
  if (const std::string passes = PassesLine(outcome); !passes.empty()) {
    spdlog::info("{}", passes);
  }
  for (const std::string& reason : outcome.reasons) {
    spdlog::warn("{}: {}", result.session, reason);
  }
  if (result.correction) {
    for (const std::string& notice : result.correction->notices) {
      spdlog::warn("{}: correction: {}", result.session, notice);
    }
  }
  if (result.bender && result.bender->outcome == CommitOutcome::kCommitted) {
    spdlog::info("{}: bender confirmed program {}", result.session, result.bender->sequence);
  }
  if (!recent_.empty() && recent_.back().session == result.session) recent_.pop_back();
  recent_.push_back(std::move(outcome.result));
  if (recent_.size() > kReportParts) {
    owed_.erase(recent_.front().session);
    recent_.pop_front();
  }
  report_is_old_ = true;
  ++parts_;
  if (storage_.report_every_parts > 0 && parts_ % storage_.report_every_parts == 0) WriteReport();
}

void PartKeeper::WriteReport() {
  // Beside the loop: the next scan may begin while the page is made. One at a time; a part that
  // comes meanwhile is in the next page, and Flush writes the last one.
  if (report_.valid() && report_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) {
    report_late_ = true;
    return;
  }
  report_is_old_ = report_late_ = false;
  const auto begun = OrOutOfMemory("the report", [&]() -> hal::Result<void> {
    report_ = std::async(
        std::launch::async, [this, path = store_.report(),
                             runs = std::vector<RunResult>(recent_.begin(), recent_.end())] {
          Judge(AlarmCode::kReportNotWritten, OrOutOfMemory(path.string() + ": the report", [&] {
                  return WriteOutputFile(path, ReportHtml(runs));
                }));
        });
    return {};
  });
  if (begun) return;
  report_is_old_ = true;
  Judge(AlarmCode::kReportNotWritten, begun);
}

bool PartKeeper::FlushWithin(std::chrono::nanoseconds patience) {
  const auto is_written = [&] {
    return !report_.valid() || report_.wait_for(patience) == std::future_status::ready;
  };
  if (!is_written()) return false;
  if (!report_late_ && (!report_is_old_ || storage_.report_every_parts == 0)) return true;
  WriteReport();
  return is_written();
}

void PartKeeper::KeepFailure(const FailedScan& failed) {
  spdlog::warn("{}: not measured: {}", failed.identity.session, failed.error.message);
  Owed owed;
  owed.result = !WriteResult(failed.identity.session, [&] {
    const Json json = {{"schema", kFailedScanSchema},   {"session", failed.identity.session},
                       {"time", failed.identity.start}, {"software", kSoftware},
                       {"profiles", failed.profiles},   {"error", failed.error.message}};
    owed.failure = Dump(json, 2) + "\n";
    return owed.failure;
  });
  Owe(failed.identity.session, std::move(owed));
}

RunResult PartKeeper::Lost(const std::string& session, const CommitReport& report) const {
  return LostPart({store_.results() / (session + ".json"), sessions_ / (session + ".session")},
                  session, report);
}

void PartKeeper::KeepLost(const CommitAttempt& attempt) {
  const std::string& session = attempt.session;
  Note([&](History& history) -> hal::Result<void> {
    if (is_anew_) return {};  // its row, and those before it, lie in the damaged one
    const auto last = history.LargestPartNumber();
    if (!last) return hal::Fail(last.error());
    if (NumberInName(session) <= *last) return {};
    const auto added = history.Add(Lost(session, EndOf(attempt)));
    if (!added) return hal::Fail(added.error());
    spdlog::warn("{}: the last run ended before it was in the history; added by the journal",
                 session);
    return {};
  });
}

void PartKeeper::Settle(const SettledCommit& settled) {
  const CommitReport& report = settled.report;
  spdlog::warn("{}: its commit is settled: {}{}{}", settled.session, Name(report.outcome),
               report.reason.empty() ? "" : ", ", report.reason);
  for (RunResult& recent : recent_) {
    if (recent.session != settled.session) continue;
    recent.bender = report;
    report_is_old_ = true;
  }
  Note([&](History& history) -> hal::Result<void> {
    const auto is_there = history.Has(settled.session);
    if (!is_there) return hal::Fail(is_there.error());
    if (*is_there) return history.SetCommit(settled.session, report);
    const auto added = history.Add(Lost(settled.session, report));
    return added ? hal::Result<void>() : hal::Fail(added.error());
  });
  const auto path = store_.results() / (settled.session + ".json");
  std::error_code none;
  if (!std::filesystem::exists(path, none)) return;  // cleared by hand, or a crash came first
  const auto text = ReadWholeFile(path);
  // Of a part that was cut short in the middle of its commit: what it says stays true.
  if (text && text->find(kFailedScanSchema) != std::string::npos) return;
  auto result = text ? ReadResultJson(*text, path.string()) : hal::Fail(text.error());
  if (!result) return Judge(AlarmCode::kResultNotKept, hal::Fail(result.error()));
  result->bender = report;
  const ResultJsonOptions same{.spine = !result->measurement.spine.empty(), .timing = true};
  Judge(AlarmCode::kResultNotKept, WriteOutputFile(path, WriteResultJson(*result, same)));
}

}  // namespace bendloop::host
