// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>

#include "drivers/sqlite/database.h"
#include "hal/result.h"

namespace bendloop::host {

// Which parts are asked for; what is empty does not matter.
struct HistoryFilter {
  std::string part = {};                 // its name
  std::optional<std::int64_t> lot = {};  // as the cell counts those of the part
  std::string verdict = {};              // "pass", "fail", "undecided"; "none": not compared
  std::string session = {};
  // UTC, as much of it as matters: "2026-11", "2026-11-22", "2026-11-22T06:30". Both are in it.
  std::string since = {};
  std::string until = {};
  std::size_t most = 0;  // the newest so many; 0: all
};

// One row of the history.
struct HistoryRow {
  std::int64_t id = 0;
  std::string time;
  std::string part;
  std::string session;
  std::optional<std::int64_t> lot;
  std::string verdict;     // "": not compared
  std::string correction;  // "": none was sent
  std::optional<std::int64_t> sequence;
  std::string result;  // bendloop.result/1
};

// The history for who only reads it, beside a running daemon, too: nothing is written, and nobody
// is kept waiting.
class HistoryReader {
 public:
  // kBadInput where there is no history, or one of another version.
  static hal::Result<HistoryReader> Open(const std::filesystem::path& path);
  // Calls for each row, oldest first.
  hal::Result<void> Each(const HistoryFilter& filter,
                         const std::function<void(const HistoryRow&)>& row) const;

 private:
  explicit HistoryReader(drivers::Database database) : database_(std::move(database)) {}
  drivers::Database database_;
};

// A time as HistoryFilter takes it: "2026-11-22T06", or "8h" and "7d", which is so long before
// `now_ms`. kUsage for any other text; `what` names the option.
hal::Result<std::string> HistoryTime(const std::string& text, std::int64_t now_ms,
                                     const std::string& what);

}  // namespace bendloop::host
