// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "drivers/sqlite/database.h"
#include "hal/result.h"

namespace bendloop::drivers {

// Opens a session for reading without changing it or leaving files beside it where that is
// possible: on read-only media, with a leftover write-ahead log, with or without its index.
hal::Result<Database> OpenSessionReadOnly(const std::string& path);

// Whether the file begins as a SQLite database does, and as a session does: by its first 100 bytes.
bool LooksLikeDatabase(const std::string& path);
bool LooksLikeSession(const std::string& path);

// What to do about a damaged one, to follow what is wrong: "; the file ends after byte 100 of 8192:
// copy it again".
std::string MendOfSession(const std::string& path);

// Opens (creates) a database for writing.
hal::Result<Database> OpenSessionForWriting(const std::string& path);

}  // namespace bendloop::drivers
