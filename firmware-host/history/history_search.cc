// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/history/history_search.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <string_view>
#include <system_error>

#include "firmware-host/history/history.h"
#include "firmware-host/ledger/moment.h"

namespace bendloop::host {
namespace {

using drivers::DatabaseOptions;
using Outcome = drivers::Statement::Outcome;
using Type = drivers::Statement::Type;

std::optional<std::int64_t> NumberOrNull(const drivers::Statement& row, int column) {
  if (row.type(column) == Type::kNull) return std::nullopt;
  return row.Integer(column);
}

HistoryRow RowOf(const drivers::Statement& row) {
  HistoryRow found;
  found.id = row.Integer(0);
  found.time = row.Text(1);
  found.part = row.Text(2);
  found.session = row.Text(3);
  found.lot = NumberOrNull(row, 4);
  found.verdict = row.Text(5);
  found.correction = row.Text(6);
  found.sequence = NumberOrNull(row, 7);
  found.result = row.Text(8);
  return found;
}

// "2026-11-22T06:30:00.123Z", or so much of its beginning.
bool IsBeginningOfATime(std::string_view text) {
  constexpr std::string_view kShape = "0000-00-00T00:00:00.000Z";
  constexpr std::array<std::size_t, 8> kWhole = {4, 7, 10, 13, 16, 19, 23, 24};
  if (std::find(kWhole.begin(), kWhole.end(), text.size()) == kWhole.end()) return false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const bool is_digit = text[i] >= '0' && text[i] <= '9';
    if (kShape[i] == '0' ? !is_digit : text[i] != kShape[i]) return false;
  }
  return true;
}

}  // namespace

hal::Result<HistoryReader> HistoryReader::Open(const std::filesystem::path& path) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     path.string() + ": there is no history" +
                         (error ? " that may be read: " + error.message() : "") +
                         "; bendloopd begins one in its state directory");
  }
  const auto open = [&](const std::string& name, bool is_uri) -> hal::Result<drivers::Database> {
    auto database = drivers::Database::Open(name, path.string(),
                                            {.access = DatabaseOptions::Access::kRead,
                                             .busy_timeout = std::chrono::seconds(2),
                                             .name_is_uri = is_uri});
    if (!database) return database;
    if (auto fits = drivers::ExpectFormat(*database, HistoryFormat()); !fits) {
      return hal::Fail(fits.error());
    }
    return database;
  };
  auto database = open(path.string(), false);
  if (!database && database.error().kind == hal::ErrorKind::kInternal) {
    // No daemon runs, and this user may not make the file that readers share with it.
    database = open("file:" + path.string() + "?immutable=1", true);
  }
  if (!database) return hal::Fail(database.error());
  return HistoryReader(std::move(*database));
}

hal::Result<void> HistoryReader::Each(const HistoryFilter& filter,
                                      const std::function<void(const HistoryRow&)>& row) const {
  auto select = database_.Prepare(
      "SELECT * FROM (SELECT id, time, part, session, lot, verdict, correction, sequence, result"
      " FROM part WHERE (?1 = '' OR part = ?1) AND (?2 IS NULL OR lot = ?2)"
      " AND (?3 = '' OR ifnull(verdict, 'none') = ?3) AND (?4 = '' OR session = ?4)"
      " AND time >= ?5 AND (?6 = '' OR time < ?6 || '~')"  // sorts behind all that begins so
      " ORDER BY id DESC LIMIT ?7) ORDER BY id");
  if (!select) return hal::Fail(select.error());
  select->Bind(filter.part).Bind(filter.lot).Bind(filter.verdict).Bind(filter.session);
  select->Bind(filter.since).Bind(filter.until);
  select->Bind(filter.most == 0 ? std::int64_t{-1} : static_cast<std::int64_t>(filter.most));
  Outcome outcome = Outcome::kRow;
  while ((outcome = select->Step()) == Outcome::kRow) row(RowOf(*select));
  if (outcome == Outcome::kFailed) return hal::Fail(database_.Failed("reading parts"));
  return {};
}

hal::Result<std::string> HistoryTime(const std::string& text, std::int64_t now_ms,
                                     const std::string& what) {
  if (text.empty() || IsBeginningOfATime(text)) return text;
  std::int64_t count = 0;
  const char* const last = text.data() + text.size() - 1;
  const auto [stop, error] = std::from_chars(text.data(), last, count);
  constexpr std::int64_t kHourMs = 3'600'000;
  constexpr std::int64_t kMost = 1'000'000;  // hours or days: more than anybody keeps
  const bool is_number = error == std::errc() && stop == last && count >= 0 && count <= kMost;
  if (is_number && *last == 'h') return UtcText(now_ms - count * kHourMs);
  if (is_number && *last == 'd') return UtcText(now_ms - count * 24 * kHourMs);
  return hal::Fail(hal::ErrorKind::kUsage,
                   what + ": found '" + text +
                       "', expected a time in UTC, e.g. 2026-11-22 or 2026-11-22T06:30, or how "
                       "long ago it is: 8h, 7d");
}

}  // namespace bendloop::host
