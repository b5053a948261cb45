// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <future>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "config/cell_config.h"
#include "firmware-host/alarms/alarm_board.h"
#include "firmware-host/cell/cell_loop.h"
#include "firmware-host/cell/part_run.h"
#include "firmware-host/commit/commit_journal.h"
#include "firmware-host/daemon/state_store.h"
#include "firmware-host/history/history.h"

namespace bendloop::host {

// What the daemon does with a finished part: keeps what the lot has learnt, the result and the
// history, and tells the log. Trouble is logged; it never stops the cell.
class PartKeeper {
 public:
  // `own` is the cell file's part. What cannot be kept is an alarm on `alarms`, which outlives it.
  PartKeeper(StateStore& store, const config::CellConfig& cell, const PartPlan& own,
             AlarmBoard& alarms);

  // No name comes twice, whatever was removed from the disk: not below `number` either, which is
  // the last one that the journal knows.
  void NameAfter(unsigned number) { last_number_ = std::max(last_number_, number); }
  ScanIdentity Identify();
  // Each part has a lot of its own, which goes on when the part is set again. Where somebody has
  // removed its file, a new lot begins. Of parts that were taken up.
  std::optional<pipeline::LotState> Lot(const PartPlan& part);
  hal::Result<void> SetLot(const PartPlan& part, const pipeline::LotState& lot);
  // Takes up the own part's lot and the history where they were left; kBadInput when one is
  // damaged.
  hal::Result<void> Load(const PartPlan& own);
  // The same of another part's lot.
  hal::Result<void> TakeUp(const PartPlan& part);
  // A part that waited comes again, and replaces what was kept of it.
  void Keep(PartOutcome outcome);
  void KeepFailure(const FailedScan& failed);
  // The end of a commit that was not known when its part was kept: result and history are set
  // right.
  void Settle(const SettledCommit& settled);
  // A part that the journal knows and the history may not: the process ended between the two. Only
  // the last one can be; an older one may have been dropped.
  void KeepLost(const CommitAttempt& attempt);
  // Into the history.
  void KeepAlarms(const std::vector<Alarm>& news);
  // What the disk did not take, as long as it is at hand: results, what the lot has learnt, the
  // history's rows, the report. Ends their alarms when it takes them.
  void TryAgain();
  // What of the latest part could not be kept, and why; "": all of it was.
  const std::string& problem() const { return problem_; }
  // What the history knows of long ago goes, but pinned parts and those `in_hand`; false where that
  // could not be done, which is told.
  bool DropOld(const std::set<std::string>& in_hand);
  // Waits for the report that is being written, for so long at most; false: the disk hangs.
  bool FlushWithin(std::chrono::nanoseconds patience);

 private:
  void WriteReport();
  // What became of a scan: the one that is not kept is the problem until one is.
  bool WriteResult(const std::string& session, const std::function<std::string()>& json);
  void KeepResult(const RunResult& result, std::uint32_t part_number);
  bool NoteResult(const RunResult& result, std::uint32_t part_number);
  bool WriteLot(std::uint32_t part_number);
  void NoteAlarms();
  // Of a part that is in no history.
  RunResult Lost(const std::string& session, const CommitReport& report) const;
  // The history, opened where it is not: a disk that was away may be back. A damaged one is moved
  // aside first.
  hal::Result<void> OpenHistory();
  hal::Result<void> SetDamagedHistoryAside();
  // Does `work` on it; where that shows it to be damaged, once more on a new one. False where it
  // was not done, which is an alarm.
  using HistoryWork = std::function<hal::Result<void>(History&)>;
  bool Note(const HistoryWork& work);
  // Logs what went wrong; an alarm until it goes well again.
  void Judge(AlarmCode code, const hal::Result<void>& kept);

  struct KeptLot {
    std::string key;         // of the settings that it was learnt with
    std::uint32_t file = 0;  // as StateStore takes it
    std::optional<pipeline::LotState> state;
  };

  // Of a scan, what the disk did not take.
  struct Owed {
    std::uint32_t part_number = 0;
    bool result = false, history = false;
    std::string failure;  // the result of one that failed
  };
  void Owe(const std::string& session, Owed owed);
  void Pay(const std::string& session, const Owed& owed);

  StateStore& store_;
  std::filesystem::path sessions_;
  config::StorageConfig storage_;
  std::uint32_t own_part_;
  AlarmBoard& alarms_;
  std::map<std::uint32_t, KeptLot> lots_;  // by part number
  std::optional<History> history_;
  bool is_anew_ = false;          // the history: a damaged one was moved aside
  std::deque<RunResult> recent_;  // for the report
  std::future<void> report_;
  bool report_late_ = false;    // a part came while it was written
  bool report_is_old_ = false;  // a part came since
  std::uint64_t parts_ = 0;
  unsigned last_number_ = 0;
  std::string problem_;
  std::map<std::string, Owed> owed_;  // by session; of measured ones, those of recent_
  std::set<std::uint32_t> owed_lots_;
  std::deque<Alarm> owed_alarms_;
};

}  // namespace bendloop::host
