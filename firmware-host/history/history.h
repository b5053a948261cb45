// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "firmware-host/result/run_result.h"
#include "hal/result.h"

struct sqlite3;

namespace bendloop::host {

struct HistoryOptions {
  std::size_t most_parts = 5000;  // the oldest go first; some 10 kB a part
};

struct HistoryPart {
  std::int64_t id = 0;  // counts up from 1 and is never used again
  RunResult result;     // without scanned surface, spine and timing
};

// The parts of a cell in the order in which they were inspected: one SQLite database (WAL, flushed
// to disk at each part), readable with any SQLite shell. Several processes may read while one adds.
// Errors: kBadInput for a file that is not a history or of a newer version, else kInternal with
// SQLite's words.
class History {
 public:
  // Creates the file if there is none. ":memory:" for tests.
  static hal::Result<History> Open(const std::filesystem::path& path,
                                   const HistoryOptions& options = {});
  History(History&& other) noexcept;
  History& operator=(History&& other) noexcept;
  ~History();

  // Adds a part and drops what is older than the newest `most_parts`, both or neither.
  hal::Result<std::int64_t> Add(const RunResult& result);
  // The newest `count` parts, oldest first; only those with this name if `part` is not empty.
  hal::Result<std::vector<HistoryPart>> Last(std::size_t count, const std::string& part = {}) const;
  hal::Result<std::size_t> Count() const;

 private:
  History(sqlite3* db, std::string name, HistoryOptions options)
      : db_(db), name_(std::move(name)), options_(options) {}
  hal::Result<void> Prepare();
  hal::Result<void> Execute(const char* sql) const;
  hal::Error Broken(const char* doing) const;

  sqlite3* db_ = nullptr;
  std::string name_;
  HistoryOptions options_;
};

}  // namespace bendloop::host
