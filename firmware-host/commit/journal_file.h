// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "drivers/sqlite/database.h"
#include "hal/result.h"

namespace bendloop::host {

// The file that the commit journal and the tube ledger share: created if there is none, flushed to
// disk at every transaction (WAL, synchronous=FULL). ":memory:" for tests. Errors are the
// database's (drivers/sqlite), kBadInput for a file that is no journal.
hal::Result<drivers::Database> OpenJournalFile(const std::filesystem::path& path);

// By the wall clock, for people who read the file.
std::int64_t UnixMilliseconds();

// Runs a statement without rows; `values`: one for each of its question marks.
template <class... Values>
hal::Result<void> Write(const drivers::Database& database, const char* sql,
                        const Values&... values) {
  auto statement = database.Prepare(sql);
  if (!statement) return hal::Fail(statement.error());
  (statement->Bind(values), ...);
  return database.Run(*statement, "cannot be written");
}

}  // namespace bendloop::host
