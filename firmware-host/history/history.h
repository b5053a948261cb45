// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "drivers/sqlite/database.h"
#include "firmware-host/alarms/alarm_board.h"
#include "firmware-host/result/run_result.h"
#include "hal/result.h"

namespace bendloop::host {

struct HistoryOptions {
  std::size_t most_parts = 5000;   // the oldest go first; some 10 kB a part
  std::size_t most_alarms = 5000;  // the oldest go first
};

struct HistoryPart {
  std::int64_t id = 0;  // counts up from 1 and is never used again
  RunResult result;     // without scanned surface, spine and timing
};

// The parts of a cell in the order in which they were inspected, and its alarms: one SQLite
// database (WAL, flushed to disk at each part), readable with any SQLite shell. Several processes
// may read while one adds. Errors: kBadInput for a file that is not a history or of a newer
// version, kDevice for the disk, else kInternal with SQLite's words.
class History {
 public:
  // Creates the file if there is none. ":memory:" for tests.
  static hal::Result<History> Open(const std::filesystem::path& path,
                                   const HistoryOptions& options = {});
  // Adds a part and drops what is older than the newest `most_parts`, both or neither.
  hal::Result<std::int64_t> Add(const RunResult& result);
  // The same for a part that may be there already: the newest with its session is replaced.
  hal::Result<void> AddOrReplace(const RunResult& result);
  // The end of a commit, of the newest part with this session; nothing when there is none.
  hal::Result<void> SetCommit(const std::string& session, const CommitReport& report);
  // The newest `count` parts, oldest first; only those with this name if `part` is not empty.
  hal::Result<std::vector<HistoryPart>> Last(std::size_t count, const std::string& part = {}) const;
  hal::Result<std::size_t> Count() const;
  // An alarm that began, or that has ended.
  hal::Result<void> NoteAlarm(const Alarm& alarm);
  // Those that a process that ended left open are over.
  hal::Result<void> EndAlarms(std::int64_t now_ms);
  // The newest `count`, oldest first.
  hal::Result<std::vector<Alarm>> LastAlarms(std::size_t count) const;

 private:
  History(drivers::Database database, HistoryOptions options)
      : database_(std::move(database)), options_(options) {}
  hal::Result<void> Prepare();
  hal::Result<void> CheckOrCreate();
  hal::Result<std::int64_t> Insert(const RunResult& result);
  hal::Result<void> Replace(std::int64_t id, const RunResult& result);

  drivers::Database database_;
  HistoryOptions options_;
};

}  // namespace bendloop::host
