// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/commit/journal_file.h"

#include <chrono>
#include <memory>

namespace bendloop::host {
namespace {

using hal::ErrorKind;

constexpr int kApplicationId = 0x424C434A;  // "BLCJ"
constexpr int kBusyMs = 2000;

// Version 2 added the ledger: program, change, tube and scan.
constexpr char kSchema[] =
    "BEGIN IMMEDIATE;"
    "CREATE TABLE IF NOT EXISTS attempt(id INTEGER PRIMARY KEY, session TEXT NOT NULL,"
    " base TEXT NOT NULL, next TEXT NOT NULL);"
    "CREATE TABLE IF NOT EXISTS step(id INTEGER PRIMARY KEY, attempt INTEGER NOT NULL,"
    " unix_ms INTEGER NOT NULL, step TEXT NOT NULL, detail TEXT NOT NULL);"
    "CREATE TABLE IF NOT EXISTS sequence(id INTEGER PRIMARY KEY, number INTEGER NOT NULL);"
    "CREATE TABLE IF NOT EXISTS program(id INTEGER PRIMARY KEY, block TEXT NOT NULL UNIQUE);"
    "CREATE TABLE IF NOT EXISTS change(id INTEGER PRIMARY KEY, unix_ms INTEGER NOT NULL,"
    " parts_bent INTEGER NOT NULL, program INTEGER NOT NULL, epoch INTEGER NOT NULL,"
    " what TEXT NOT NULL);"
    "CREATE TABLE IF NOT EXISTS tube(id INTEGER PRIMARY KEY, unix_ms INTEGER NOT NULL,"
    " count INTEGER, program INTEGER, epoch INTEGER NOT NULL, doubt TEXT NOT NULL);"
    "CREATE TABLE IF NOT EXISTS scan(id INTEGER PRIMARY KEY, unix_ms INTEGER NOT NULL,"
    " session TEXT NOT NULL, tube INTEGER, state TEXT NOT NULL, detail TEXT NOT NULL);"
    "CREATE INDEX IF NOT EXISTS attempt_session ON attempt(session);"
    "CREATE INDEX IF NOT EXISTS step_attempt ON step(attempt);"
    "CREATE INDEX IF NOT EXISTS scan_session ON scan(session);"
    "CREATE INDEX IF NOT EXISTS scan_tube ON scan(tube);"
    "PRAGMA user_version = 2;"
    "COMMIT;";

struct Close {
  void operator()(sqlite3* db) const { sqlite3_close(db); }
};

}  // namespace

hal::Error SqlError(sqlite3* db, const char* doing) {
  const int code = sqlite3_errcode(db);
  const bool not_ours = code == SQLITE_NOTADB || code == SQLITE_CORRUPT;
  return {not_ours ? ErrorKind::kBadInput : ErrorKind::kInternal,
          std::string("commit journal: cannot ") + doing + ": " + sqlite3_errmsg(db)};
}

std::int64_t UnixMilliseconds() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::milliseconds>(now).count();
}

hal::Result<sqlite3*> OpenJournalFile(const std::filesystem::path& path) {
  sqlite3* raw = nullptr;
  const int opened = sqlite3_open(path.c_str(), &raw);
  std::unique_ptr<sqlite3, Close> db(raw);
  const auto named = [&path](hal::Error error) {
    error.message += " (" + path.string() + ")";
    return hal::Fail(std::move(error));
  };
  if (opened != SQLITE_OK) return named(SqlError(raw, "open the file"));
  sqlite3_busy_timeout(raw, kBusyMs);
  {
    Statement id(raw, "PRAGMA application_id");
    if (id.Step() != SQLITE_ROW) return named(SqlError(raw, "read the file"));
    Statement tables(raw, "SELECT count(*) FROM sqlite_master");
    if (tables.Step() != SQLITE_ROW) return named(SqlError(raw, "read the file"));
    if (id.Integer(0) != kApplicationId && tables.Integer(0) != 0) {
      return hal::Fail(ErrorKind::kBadInput, "commit journal " + path.string() +
                                                 ": a database of something else; expected "
                                                 "application_id 0x424C434A or a new file");
    }
  }
  const std::string pragmas = "PRAGMA application_id = " + std::to_string(kApplicationId) +
                              "; PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL;";
  if (sqlite3_exec(raw, pragmas.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK ||
      sqlite3_exec(raw, kSchema, nullptr, nullptr, nullptr) != SQLITE_OK) {
    return named(SqlError(raw, "prepare the file"));
  }
  return db.release();
}

}  // namespace bendloop::host
