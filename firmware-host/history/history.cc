// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/history/history.h"

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>

#include "firmware-host/ledger/moment.h"
#include "firmware-host/result/json.h"
#include "firmware-host/result/result_json.h"
#include "firmware-host/result/words.h"
#include "firmware-host/retention/age.h"

namespace bendloop::host {
namespace {

constexpr std::chrono::seconds kBusyTimeout{2};  // for another process that adds

constexpr const char* kVersion1 =
    "CREATE TABLE part("
    "  id INTEGER PRIMARY KEY AUTOINCREMENT,"
    "  time TEXT NOT NULL,"     // ISO 8601, start of the scan
    "  part TEXT NOT NULL,"     // name of the part
    "  session TEXT NOT NULL,"  // recording
    "  verdict TEXT,"           // pass, fail, undecided; NULL: not compared
    "  correction TEXT,"        // committed, refused, failed, unknown; NULL: none was sent
    "  sequence INTEGER,"       // of the program that was sent
    "  result TEXT NOT NULL);"  // bendloop.result/1 without spine and timing
    "CREATE INDEX part_name ON part(part, id);";

// The alarms came later than the first files of version 1, and without a number of their own.
constexpr const char* kVersion2 =
    "CREATE TABLE IF NOT EXISTS alarm("
    "  id INTEGER PRIMARY KEY AUTOINCREMENT,"
    "  code INTEGER NOT NULL,"   // 1001: BL1001
    "  severity TEXT NOT NULL,"  // notice, warning, fault
    "  text TEXT NOT NULL,"
    "  detail TEXT NOT NULL,"
    "  began TEXT NOT NULL,"  // ISO 8601
    "  ended TEXT,"           // NULL: it goes on
    "  UNIQUE(code, began));"
    "ALTER TABLE part ADD COLUMN lot INTEGER;"  // counted for each part; NULL: not known
    "CREATE INDEX part_time ON part(time);"
    "CREATE INDEX part_session ON part(session);";

constexpr const char* kSteps[] = {kVersion1, kVersion2};

// Verdict, commit and sequence.
void BindOutcome(drivers::Statement& statement, const RunResult& result) {
  if (result.inspection) {
    statement.Bind(Word(result.inspection->verdict));
  } else {
    statement.BindNull();
  }
  if (result.bender) {
    statement.Bind(Word(result.bender->outcome)).Bind(result.bender->sequence);
  } else {
    statement.BindNull().BindNull();
  }
}

}  // namespace

const drivers::DatabaseFormat& HistoryFormat() {
  static constexpr drivers::DatabaseFormat kFormat{0x424C4849, "BLHI", "history of parts", kSteps};
  return kFormat;
}

hal::Result<History> History::Open(const std::filesystem::path& path,
                                   const HistoryOptions& options) {
  auto database =
      drivers::Database::Open(path.string(), path.string(),
                              {.busy_timeout = kBusyTimeout,
                               .mend_damage = "; move the file away, and a new history is begun"});
  if (!database) {
    hal::Error error = database.error();
    error.message += "; expected a folder that can be written";
    return hal::Fail(std::move(error));
  }
  if (auto fits = drivers::BringToFormat(*database, HistoryFormat()); !fits) {
    return hal::Fail(fits.error());
  }
  const auto done = database->Execute("PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL");
  if (!done) return hal::Fail(done.error());
  return History(std::move(*database), options);
}

hal::Result<std::int64_t> History::Add(const RunResult& result, std::optional<std::int64_t> lot) {
  std::int64_t id = 0;
  const auto added = database_.Transact("adding a part", [&]() -> hal::Result<void> {
    const auto inserted = Insert(result, lot);
    if (!inserted) return hal::Fail(inserted.error());
    id = *inserted;
    auto drop = database_.Prepare(
        "DELETE FROM part WHERE id <= ? AND session NOT IN (SELECT value FROM json_each(?))");
    if (!drop) return hal::Fail(drop.error());
    const auto most =
        static_cast<std::int64_t>(std::clamp<std::size_t>(options_.most_parts, 1, 1'000'000'000));
    drop->Bind(id - most).Bind(Dump(kept_));
    return database_.Run(*drop, "dropping old parts");
  });
  if (!added) return hal::Fail(added.error());
  return id;
}

hal::Result<std::int64_t> History::Insert(const RunResult& result,
                                          std::optional<std::int64_t> lot) {
  auto insert = database_.Prepare(
      "INSERT INTO part(time, part, session, lot, verdict, correction, sequence, result)"
      " VALUES(?, ?, ?, ?, ?, ?, ?, ?)");
  if (!insert) return hal::Fail(insert.error());
  insert->Bind(result.time).Bind(result.part).Bind(result.session).Bind(lot);
  BindOutcome(*insert, result);
  insert->Bind(Dump(ResultJson(result, {.spine = false, .timing = false})));
  if (auto done = database_.Run(*insert, "adding a part"); !done) return hal::Fail(done.error());
  return database_.last_id();
}

hal::Result<void> History::Replace(std::int64_t id, const RunResult& result) {
  auto update = database_.Prepare(
      "UPDATE part SET verdict = ?, correction = ?, sequence = ?, result = ? WHERE id = ?");
  if (!update) return hal::Fail(update.error());
  BindOutcome(*update, result);
  update->Bind(Dump(ResultJson(result, {.spine = false, .timing = false}))).Bind(id);
  return database_.Run(*update, "changing a part");
}

hal::Result<void> History::AddOrReplace(const RunResult& result, std::optional<std::int64_t> lot) {
  auto find = database_.Prepare("SELECT id FROM part WHERE session = ? ORDER BY id DESC LIMIT 1");
  if (!find) return hal::Fail(find.error());
  find->Bind(result.session);
  const auto row = find->Step();
  if (row == drivers::Statement::Outcome::kFailed) {
    return hal::Fail(database_.Failed("looking for a part"));
  }
  if (row == drivers::Statement::Outcome::kRow) {
    const std::int64_t id = find->Integer(0);
    find->Reset();
    return Replace(id, result);
  }
  if (auto added = Add(result, lot); !added) return hal::Fail(added.error());
  return {};
}

hal::Result<bool> History::Has(const std::string& session) const {
  auto find = database_.Prepare("SELECT 1 FROM part WHERE session = ? LIMIT 1");
  if (!find) return hal::Fail(find.error());
  find->Bind(session);
  const auto row = find->Step();
  if (row != drivers::Statement::Outcome::kFailed) return row == drivers::Statement::Outcome::kRow;
  return hal::Fail(database_.Failed("looking for a part"));
}

hal::Result<void> History::SetCommit(const std::string& session, const CommitReport& report) {
  auto find =
      database_.Prepare("SELECT id, result FROM part WHERE session = ? ORDER BY id DESC LIMIT 1");
  if (!find) return hal::Fail(find.error());
  find->Bind(session);
  const auto row = find->Step();
  if (row == drivers::Statement::Outcome::kFailed) {
    return hal::Fail(database_.Failed("looking for a part"));
  }
  if (row == drivers::Statement::Outcome::kEnd) return {};
  const std::int64_t id = find->Integer(0);
  auto result = ReadResultJson(find->Text(1), database_.path() + ": part " + std::to_string(id));
  if (!result) return hal::Fail(result.error());
  find->Reset();
  result->bender = report;
  return Replace(id, *result);
}

hal::Result<std::vector<HistoryPart>> History::Last(std::size_t count,
                                                    const std::string& part) const {
  auto select = database_.Prepare(
      part.empty() ? "SELECT id, result FROM part ORDER BY id DESC LIMIT ?"
                   : "SELECT id, result FROM part WHERE part = ?2 ORDER BY id DESC LIMIT ?1");
  if (!select) return hal::Fail(select.error());
  select->Bind(static_cast<std::int64_t>(std::min<std::size_t>(count, 1'000'000)));
  if (!part.empty()) select->Bind(part);
  std::vector<HistoryPart> parts;
  auto outcome = drivers::Statement::Outcome::kRow;
  while ((outcome = select->Step()) == drivers::Statement::Outcome::kRow) {
    const std::int64_t id = select->Integer(0);
    auto result =
        ReadResultJson(select->Text(1), database_.path() + ": part " + std::to_string(id));
    if (!result) return hal::Fail(result.error());
    parts.push_back({id, std::move(*result)});
  }
  if (outcome == drivers::Statement::Outcome::kFailed) {
    return hal::Fail(database_.Failed("reading parts"));
  }
  std::reverse(parts.begin(), parts.end());
  return parts;
}

hal::Result<std::size_t> History::DropOld(double most_days, std::int64_t now_ms) {
  std::size_t dropped = 0;
  const auto done = database_.Transact("dropping old parts", [&]() -> hal::Result<void> {
    auto select = database_.Prepare("SELECT id, time, session FROM part ORDER BY id DESC");
    if (!select) return hal::Fail(select.error());
    Age age(now_ms);
    auto outcome = drivers::Statement::Outcome::kRow;
    std::vector<std::int64_t> old;
    while ((outcome = select->Step()) == drivers::Statement::Outcome::kRow) {
      const double days = age.DaysOf(ParseUtc(std::string(select->Text(1))).value_or(now_ms));
      const bool is_kept = std::find(kept_.begin(), kept_.end(), select->Text(2)) != kept_.end();
      if (days > most_days && !is_kept) old.push_back(select->Integer(0));
    }
    if (outcome == drivers::Statement::Outcome::kFailed) {
      return hal::Fail(database_.Failed("reading parts"));
    }
    auto drop = database_.Prepare("DELETE FROM part WHERE id = ?");
    if (!drop) return hal::Fail(drop.error());
    for (const std::int64_t id : old) {
      drop->Bind(id);
      if (auto gone = database_.Run(*drop, "dropping old parts"); !gone) return gone;
    }
    dropped = old.size();
    return {};
  });
  if (!done) return hal::Fail(done.error());
  return dropped;
}

hal::Result<unsigned> History::LargestPartNumber() const {
  const auto number = database_.Integer(
      "SELECT ifnull(max(CAST(substr(session, 6) AS INTEGER)), 0) FROM part"
      " WHERE session LIKE 'part-%'");
  if (!number) return hal::Fail(number.error());
  return static_cast<unsigned>(*number);
}

hal::Result<std::size_t> History::Count() const {
  const auto count = database_.Integer("SELECT count(*) FROM part");
  if (!count) return hal::Fail(count.error());
  return static_cast<std::size_t>(*count);
}

}  // namespace bendloop::host
