// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/history/history.h"

#include <sqlite3.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <utility>

#include "firmware-host/result/result_json.h"
#include "firmware-host/result/words.h"

namespace bendloop::host {
namespace {

constexpr int kApplicationId = 0x424C4849;  // "BLHI"
constexpr int kVersion = 1;

constexpr const char* kSchema =
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

struct Finalize {
  void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
};
using Statement = std::unique_ptr<sqlite3_stmt, Finalize>;

Statement MakeStatement(sqlite3* db, const char* sql) {
  sqlite3_stmt* statement = nullptr;
  sqlite3_prepare_v2(db, sql, -1, &statement, nullptr);
  return Statement(statement);
}

void BindText(const Statement& statement, int index, std::string_view text) {
  sqlite3_bind_text(statement.get(), index, text.data(), static_cast<int>(text.size()),
                    SQLITE_TRANSIENT);
}

std::string_view Text(const Statement& statement, int column) {
  const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement.get(), column));
  return text ? std::string_view(
                    text, static_cast<std::size_t>(sqlite3_column_bytes(statement.get(), column)))
              : std::string_view();
}

// The one number that `sql` gives; -1 when it fails.
std::int64_t Single(sqlite3* db, const char* sql) {
  const Statement statement = MakeStatement(db, sql);
  if (!statement || sqlite3_step(statement.get()) != SQLITE_ROW) return -1;
  return sqlite3_column_int64(statement.get(), 0);
}

}  // namespace

History::History(History&& other) noexcept
    : db_(std::exchange(other.db_, nullptr)),
      name_(std::move(other.name_)),
      options_(other.options_) {}

History& History::operator=(History&& other) noexcept {
  std::swap(db_, other.db_);
  std::swap(name_, other.name_);
  std::swap(options_, other.options_);
  return *this;
}

History::~History() { sqlite3_close(db_); }

hal::Error History::Broken(const char* doing) const {
  const int code = sqlite3_errcode(db_) & 0xFF;
  const bool bad_file = code == SQLITE_NOTADB || code == SQLITE_CORRUPT;
  return {bad_file ? hal::ErrorKind::kBadInput : hal::ErrorKind::kInternal,
          name_ + ": " + doing + ": " + sqlite3_errmsg(db_) +
              (bad_file ? "; move the file away, and a new history is begun" : "")};
}

hal::Result<void> History::Execute(const char* sql) const {
  if (sqlite3_exec(db_, sql, nullptr, nullptr, nullptr) != SQLITE_OK) {
    return hal::Fail(Broken("history"));
  }
  return {};
}

hal::Result<History> History::Open(const std::filesystem::path& path,
                                   const HistoryOptions& options) {
  sqlite3* db = nullptr;
  const int opened =
      sqlite3_open_v2(path.c_str(), &db, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, nullptr);
  History history(db, path.string(), options);
  if (opened != SQLITE_OK) {
    return hal::Fail(hal::ErrorKind::kInternal, path.string() +
                                                    ": cannot be opened: " + sqlite3_errmsg(db) +
                                                    "; expected a folder that can be written");
  }
  if (auto prepared = history.Prepare(); !prepared) return hal::Fail(prepared.error());
  return history;
}

hal::Result<void> History::Prepare() {
  sqlite3_busy_timeout(db_, 2000);
  // IMMEDIATE, so that two processes that create the file do not both write the schema.
  if (auto done = Execute("PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; BEGIN IMMEDIATE");
      !done) {
    return done;
  }
  const std::int64_t application = Single(db_, "PRAGMA application_id");
  const std::int64_t version = Single(db_, "PRAGMA user_version");
  const std::int64_t tables = Single(db_, "SELECT count(*) FROM sqlite_master");
  if (application == 0 && version == 0 && tables == 0) {
    const std::string create = std::string(kSchema) +
                               "PRAGMA application_id=" + std::to_string(kApplicationId) +
                               "; PRAGMA user_version=" + std::to_string(kVersion) + "; COMMIT";
    return Execute(create.c_str());
  }
  sqlite3_exec(db_, "ROLLBACK", nullptr, nullptr, nullptr);
  if (application != kApplicationId) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     name_ + ": application_id " + std::to_string(application) + ", expected " +
                         std::to_string(kApplicationId) +
                         " (\"BLHI\"): not a history of parts; choose another file");
  }
  if (version != kVersion) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     name_ + ": user_version " + std::to_string(version) + ", expected " +
                         std::to_string(kVersion) + ": written by another version of bendloop");
  }
  return {};
}

hal::Result<std::int64_t> History::Add(const RunResult& result) {
  if (auto begun = Execute("BEGIN IMMEDIATE"); !begun) return hal::Fail(begun.error());
  const auto fail = [&](const char* doing) {
    const hal::Error error = Broken(doing);
    sqlite3_exec(db_, "ROLLBACK", nullptr, nullptr, nullptr);
    return hal::Fail(error);
  };
  const Statement insert =
      MakeStatement(db_,
                    "INSERT INTO part(time, part, session, verdict, correction, sequence, result)"
                    " VALUES(?, ?, ?, ?, ?, ?, ?)");
  if (!insert) return fail("adding a part");
  BindText(insert, 1, result.time);
  BindText(insert, 2, result.part);
  BindText(insert, 3, result.session);
  if (result.inspection) BindText(insert, 4, Word(result.inspection->verdict));
  if (result.bender) {
    BindText(insert, 5, Word(result.bender->outcome));
    sqlite3_bind_int64(insert.get(), 6, result.bender->sequence);
  }
  BindText(insert, 7, Dump(ResultJson(result, {.spine = false, .timing = false})));
  if (sqlite3_step(insert.get()) != SQLITE_DONE) return fail("adding a part");
  const std::int64_t id = sqlite3_last_insert_rowid(db_);

  const Statement drop = MakeStatement(db_, "DELETE FROM part WHERE id <= ?");
  if (!drop) return fail("dropping old parts");
  const auto most =
      static_cast<std::int64_t>(std::clamp<std::size_t>(options_.most_parts, 1, 1'000'000'000));
  sqlite3_bind_int64(drop.get(), 1, id - most);
  if (sqlite3_step(drop.get()) != SQLITE_DONE) return fail("dropping old parts");
  if (sqlite3_exec(db_, "COMMIT", nullptr, nullptr, nullptr) != SQLITE_OK) {
    return fail("adding a part");
  }
  return id;
}

hal::Result<std::vector<HistoryPart>> History::Last(std::size_t count,
                                                    const std::string& part) const {
  const Statement select = MakeStatement(
      db_, part.empty() ? "SELECT id, result FROM part ORDER BY id DESC LIMIT ?"
                        : "SELECT id, result FROM part WHERE part = ?2 ORDER BY id DESC LIMIT ?1");
  if (!select) return hal::Fail(Broken("reading parts"));
  sqlite3_bind_int64(select.get(), 1,
                     static_cast<std::int64_t>(std::min<std::size_t>(count, 1'000'000)));
  if (!part.empty()) BindText(select, 2, part);
  std::vector<HistoryPart> parts;
  int step = SQLITE_ROW;
  while ((step = sqlite3_step(select.get())) == SQLITE_ROW) {
    const std::int64_t id = sqlite3_column_int64(select.get(), 0);
    auto result = ReadResultJson(Text(select, 1), name_ + ": part " + std::to_string(id));
    if (!result) return hal::Fail(result.error());
    parts.push_back({id, std::move(*result)});
  }
  if (step != SQLITE_DONE) return hal::Fail(Broken("reading parts"));
  std::reverse(parts.begin(), parts.end());
  return parts;
}

hal::Result<std::size_t> History::Count() const {
  const std::int64_t count = Single(db_, "SELECT count(*) FROM part");
  if (count < 0) return hal::Fail(Broken("counting parts"));
  return static_cast<std::size_t>(count);
}

}  // namespace bendloop::host
