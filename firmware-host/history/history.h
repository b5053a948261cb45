// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "drivers/sqlite/database.h"
#include "drivers/sqlite/database_format.h"
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

// Whose the file is, for who opens it by himself.
const drivers::DatabaseFormat& HistoryFormat();

// The parts of a cell in the order in which they were inspected, and its alarms: one SQLite
// database (WAL, flushed to disk at each part), readable with any SQLite shell. Several processes
// may read while one adds. Errors: kBadInput for a file that is not a history or of a newer
// version, kDevice for the disk, else kInternal with SQLite's words.
class History {
 public:
  // Creates the file if there is none. ":memory:" for tests.
  static hal::Result<History> Open(const std::filesystem::path& path,
                                   const HistoryOptions& options = {});
  // Adds a part and drops what is older than the newest `most_parts`, both or neither; those of the
  // sessions `kept` stay.
  // `lot`: as the cell counts those of the part; empty: not known.
  hal::Result<std::int64_t> Add(const RunResult& result, std::optional<std::int64_t> lot = {});
  // The same for a part that may be there already: the newest with its session is replaced.
  hal::Result<void> AddOrReplace(const RunResult& result, std::optional<std::int64_t> lot = {});
  // Drops parts older than this (retention/age.h); how many.
  hal::Result<std::size_t> DropOld(double most_days, std::int64_t now_ms);
  // Is there a part with this session?
  hal::Result<bool> Has(const std::string& session) const;
  // The end of a commit, of the newest part with this session; nothing when there is none.
  hal::Result<void> SetCommit(const std::string& session, const CommitReport& report);
  // The newest `count` parts, oldest first; only those with this name if `part` is not empty.
  hal::Result<std::vector<HistoryPart>> Last(std::size_t count, const std::string& part = {}) const;
  hal::Result<std::size_t> Count() const;
  // 7 when "part-0007" is the last session there.
  hal::Result<unsigned> LargestPartNumber() const;
  // Sessions that are never dropped: pinned ones, and those whose correction is still to be sent.
  void Keep(std::vector<std::string> sessions) { kept_ = std::move(sessions); }
  // An alarm that began, or that has ended.
  hal::Result<void> NoteAlarm(const Alarm& alarm);
  // Those that a process that ended left open are over.
  hal::Result<void> EndAlarms(std::int64_t now_ms);
  // The newest `count`, oldest first.
  hal::Result<std::vector<Alarm>> LastAlarms(std::size_t count) const;

 private:
  History(drivers::Database database, HistoryOptions options)
      : database_(std::move(database)), options_(options) {}
  hal::Result<std::int64_t> Insert(const RunResult& result, std::optional<std::int64_t> lot);
  hal::Result<void> Replace(std::int64_t id, const RunResult& result);

  drivers::Database database_;
  HistoryOptions options_;
  std::vector<std::string> kept_;
};

}  // namespace bendloop::host
