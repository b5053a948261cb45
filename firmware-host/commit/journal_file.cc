// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/commit/journal_file.h"

#include <chrono>
#include <utility>

namespace bendloop::host {
namespace {

constexpr int kApplicationId = 0x424C434A;       // "BLCJ"
constexpr std::chrono::seconds kBusyTimeout{2};  // for another process that writes

// Version 2 added the ledger: program, change, tube and scan; version 3 void, breach and
// acknowledgement.
constexpr char kSchema[] =
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
    "CREATE TABLE IF NOT EXISTS void(sequence INTEGER PRIMARY KEY);"  // sequence.id
    "CREATE TABLE IF NOT EXISTS breach(id INTEGER PRIMARY KEY, unix_ms INTEGER NOT NULL,"
    " cause TEXT NOT NULL UNIQUE, detail TEXT NOT NULL);"
    "CREATE TABLE IF NOT EXISTS acknowledgement(id INTEGER PRIMARY KEY, unix_ms INTEGER NOT NULL,"
    " breach INTEGER NOT NULL, who TEXT NOT NULL);"
    "CREATE INDEX IF NOT EXISTS attempt_session ON attempt(session);"
    "CREATE INDEX IF NOT EXISTS step_attempt ON step(attempt);"
    "CREATE INDEX IF NOT EXISTS scan_session ON scan(session);"
    "CREATE INDEX IF NOT EXISTS scan_tube ON scan(tube);"
    "PRAGMA user_version = 3;";

// Whose file it is, and what is missing in it.
hal::Result<void> CheckOrCreate(const drivers::Database& database) {
  const auto application = database.Integer("PRAGMA application_id");
  if (!application) return hal::Fail(application.error());
  const auto tables = database.Integer("SELECT count(*) FROM sqlite_master");
  if (!tables) return hal::Fail(tables.error());
  if (*application != kApplicationId && *tables != 0) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "commit journal " + database.path() +
                         ": a database of something else; expected application_id 0x424C434A or a "
                         "new file");
  }
  return database.Execute("PRAGMA application_id = " + std::to_string(kApplicationId) + ";" +
                          kSchema);
}

}  // namespace

std::int64_t UnixMilliseconds() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::milliseconds>(now).count();
}

hal::Result<drivers::Database> OpenJournalFile(const std::filesystem::path& path) {
  auto database = drivers::Database::Open(
      path.string(), path.string(),
      {.busy_timeout = kBusyTimeout,
       .mend_damage = "; move the file away, and a new commit journal is begun"});
  if (!database) return database;
  // A stranger's file is not touched: the mode of its journal is written into it.
  const auto readable = database->Integer("SELECT count(*) FROM sqlite_master");
  if (!readable) return hal::Fail(readable.error());
  const auto begun = database->Transact("the commit journal cannot be prepared",
                                        [&] { return CheckOrCreate(*database); });
  if (!begun) return hal::Fail(begun.error());
  if (auto done = database->Execute("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL");
      !done) {
    return hal::Fail(done.error());
  }
  return database;
}

}  // namespace bendloop::host
