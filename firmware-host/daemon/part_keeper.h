// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <deque>
#include <filesystem>
#include <future>
#include <string>
#include <vector>

#include "firmware-host/alarms/alarm_board.h"
#include "firmware-host/cell/cell_loop.h"
#include "firmware-host/cell/part_run.h"
#include "firmware-host/daemon/state_store.h"
#include "firmware-host/history/history.h"

namespace bendloop::host {

// What the daemon does with a finished part: keeps what the lot has learnt, the result and the
// history, and tells the log. Trouble is logged; it never stops the cell.
class PartKeeper {
 public:
  // What cannot be kept is an alarm on `alarms`, which outlives it.
  PartKeeper(StateStore& store, std::filesystem::path sessions, std::string lot_key,
             AlarmBoard& alarms);

  // No name comes twice, whatever was removed from the disk: not below `number` either, which is
  // the last one that the journal knows.
  void NameAfter(unsigned number) { last_number_ = std::max(last_number_, number); }
  ScanIdentity Identify();
  // Of the state directory: where somebody has removed lot.json, a new lot begins.
  std::optional<pipeline::LotState> Lot();
  hal::Result<void> SetLot(const pipeline::LotState& lot);
  // Takes up the lot and the history where they were left; kBadInput when one is damaged.
  hal::Result<void> Load();
  // A part that waited comes again, and replaces what was kept of it.
  void Keep(PartOutcome outcome);
  void KeepFailure(const FailedScan& failed);
  // The end of a commit that was not known when its part was kept: result and history are set
  // right.
  void Settle(const SettledCommit& settled);
  // Into the history.
  void KeepAlarms(const std::vector<Alarm>& news);
  // What of the latest part could not be kept, and why; "": all of it was.
  const std::string& problem() const { return problem_; }
  // Waits for the report that is being written, for so long at most; false: the disk hangs.
  bool FlushWithin(std::chrono::nanoseconds patience);

 private:
  void WriteReport();
  void KeepResult(const RunResult& result);
  // Logs what went wrong; an alarm until it goes well again.
  void Judge(AlarmCode code, const hal::Result<void>& kept);

  StateStore& store_;
  std::filesystem::path sessions_;
  std::string lot_key_;
  AlarmBoard& alarms_;
  std::optional<pipeline::LotState> lot_;
  std::optional<History> history_;
  std::deque<RunResult> recent_;  // for the report
  std::future<void> report_;
  bool report_late_ = false;
  unsigned last_number_ = 0;
  std::string problem_;
};

}  // namespace bendloop::host
