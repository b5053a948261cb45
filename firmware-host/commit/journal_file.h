// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sqlite3.h>

#include <cstdint>
#include <filesystem>
#include <string>

#include "hal/result.h"

namespace bendloop::host {

// The file that the commit journal and the tube ledger share: created if there is none, flushed to
// disk at every transaction (SQLite, WAL, synchronous=FULL). ":memory:" for tests. The caller
// closes. Errors are kInternal with SQLite's words, or kBadInput for a file that is no journal.
hal::Result<sqlite3*> OpenJournalFile(const std::filesystem::path& path);

hal::Error SqlError(sqlite3* db, const char* doing);

// By the wall clock, for people who read the file.
std::int64_t UnixMilliseconds();

// A prepared statement; text is copied in and out.
class Statement {
 public:
  Statement(sqlite3* db, const char* sql) {
    prepared_ = sqlite3_prepare_v2(db, sql, -1, &statement_, nullptr) == SQLITE_OK;
  }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  Statement& Bind(const std::string& text) {
    sqlite3_bind_text(statement_, ++bound_, text.data(), static_cast<int>(text.size()),
                      SQLITE_TRANSIENT);
    return *this;
  }
  Statement& Bind(std::int64_t number) {
    sqlite3_bind_int64(statement_, ++bound_, number);
    return *this;
  }
  Statement& BindNull() {
    ++bound_;  // what is not bound is NULL
    return *this;
  }
  int Step() { return prepared_ ? sqlite3_step(statement_) : SQLITE_ERROR; }
  std::string Text(int column) {
    const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement_, column));
    return text == nullptr ? std::string() : std::string(text);
  }
  std::int64_t Integer(int column) { return sqlite3_column_int64(statement_, column); }
  bool IsNull(int column) { return sqlite3_column_type(statement_, column) == SQLITE_NULL; }

 private:
  sqlite3_stmt* statement_ = nullptr;
  bool prepared_ = false;
  int bound_ = 0;
};

// One transaction: the pieces reach the disk together or not at all.
template <class Work>
hal::Result<void> InTransaction(sqlite3* db, const char* doing, Work work) {
  bool ok = sqlite3_exec(db, "BEGIN IMMEDIATE", nullptr, nullptr, nullptr) == SQLITE_OK;
  ok = ok && work() && sqlite3_exec(db, "COMMIT", nullptr, nullptr, nullptr) == SQLITE_OK;
  if (ok) return {};
  hal::Error error = SqlError(db, doing);
  sqlite3_exec(db, "ROLLBACK", nullptr, nullptr, nullptr);
  return hal::Fail(std::move(error));
}

}  // namespace bendloop::host
