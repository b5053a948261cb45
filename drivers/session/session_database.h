// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sqlite3.h>

#include <memory>
#include <string>

#include "hal/result.h"

namespace bendloop::drivers {

struct DatabaseCloser {
  void operator()(sqlite3* database) const { sqlite3_close_v2(database); }
};
struct StatementFinalizer {
  void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
};
using DatabasePtr = std::unique_ptr<sqlite3, DatabaseCloser>;
using StatementPtr = std::unique_ptr<sqlite3_stmt, StatementFinalizer>;

// Opens a session for reading without changing it or leaving files beside it where that is
// possible: on read-only media, with a leftover write-ahead log, with or without its index.
hal::Result<DatabasePtr> OpenSessionReadOnly(const std::string& path);

// Opens (creates) a database for writing.
hal::Result<DatabasePtr> OpenSessionForWriting(const std::string& path);

hal::Result<StatementPtr> Prepare(sqlite3* database, const std::string& path, const char* sql);
hal::Result<void> Execute(sqlite3* database, const std::string& path, const char* sql);

// The error of the last call on `database`: damage is kBadInput, a full or failing disk kDevice.
// `what` says what was being done.
hal::Error DatabaseError(sqlite3* database, const std::string& path, const std::string& what);

}  // namespace bendloop::drivers
