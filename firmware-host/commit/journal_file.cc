// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/commit/journal_file.h"

#include <chrono>
#include <utility>

#include "drivers/sqlite/database_format.h"

namespace bendloop::host {
namespace {

constexpr std::chrono::seconds kBusyTimeout{2};  // for another process that writes

constexpr const char* kVersion1 =
    "CREATE TABLE attempt(id INTEGER PRIMARY KEY, session TEXT NOT NULL,"
    " base TEXT NOT NULL, next TEXT NOT NULL);"
    "CREATE TABLE step(id INTEGER PRIMARY KEY, attempt INTEGER NOT NULL,"
    " unix_ms INTEGER NOT NULL, step TEXT NOT NULL, detail TEXT NOT NULL);"
    "CREATE TABLE sequence(id INTEGER PRIMARY KEY, number INTEGER NOT NULL);"
    "CREATE INDEX attempt_session ON attempt(session);"
    "CREATE INDEX step_attempt ON step(attempt);";

// The ledger.
constexpr const char* kVersion2 =
    "CREATE TABLE program(id INTEGER PRIMARY KEY, block TEXT NOT NULL UNIQUE);"
    "CREATE TABLE change(id INTEGER PRIMARY KEY, unix_ms INTEGER NOT NULL,"
    " parts_bent INTEGER NOT NULL, program INTEGER NOT NULL, epoch INTEGER NOT NULL,"
    " what TEXT NOT NULL);"
    "CREATE TABLE tube(id INTEGER PRIMARY KEY, unix_ms INTEGER NOT NULL,"
    " count INTEGER, program INTEGER, epoch INTEGER NOT NULL, doubt TEXT NOT NULL);"
    "CREATE TABLE scan(id INTEGER PRIMARY KEY, unix_ms INTEGER NOT NULL,"
    " session TEXT NOT NULL, tube INTEGER, state TEXT NOT NULL, detail TEXT NOT NULL);"
    "CREATE INDEX scan_session ON scan(session);"
    "CREATE INDEX scan_tube ON scan(tube);";

// What is staged to be never committed, and the lock of a bender that broke a rule.
constexpr const char* kVersion3 =
    "CREATE TABLE void(sequence INTEGER PRIMARY KEY);"  // sequence.id
    "CREATE TABLE breach(id INTEGER PRIMARY KEY, unix_ms INTEGER NOT NULL,"
    " cause TEXT NOT NULL UNIQUE, detail TEXT NOT NULL);"
    "CREATE TABLE acknowledgement(id INTEGER PRIMARY KEY, unix_ms INTEGER NOT NULL,"
    " breach INTEGER NOT NULL, who TEXT NOT NULL);";

// What tubes are called, that were used up.
constexpr const char* kVersion4 =
    "CREATE TABLE name(id INTEGER PRIMARY KEY, unix_ms INTEGER NOT NULL,"
    " session TEXT NOT NULL, part_number INTEGER NOT NULL, name TEXT NOT NULL);"
    "CREATE INDEX name_name ON name(name, part_number);"
    "CREATE INDEX name_session ON name(session);";

// Steps may be "failed".
constexpr const char* kVersion5 = "";

constexpr const char* kFormatSteps[] = {kVersion1, kVersion2, kVersion3, kVersion4, kVersion5};
constexpr drivers::DatabaseFormat kJournalFormat{0x424C434A, "BLCJ", "commit journal",
                                                 kFormatSteps};

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
  if (auto fits = drivers::BringToFormat(*database, kJournalFormat); !fits)
    return hal::Fail(fits.error());
  if (auto done = database->Execute("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL");
      !done) {
    return hal::Fail(done.error());
  }
  return database;
}

}  // namespace bendloop::host
