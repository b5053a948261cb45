// SPDX-License-Identifier: Apache-2.0
#include "drivers/session/session_database.h"

#include <sys/stat.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <string_view>
#include <system_error>

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using hal::Fail;
using hal::Result;

constexpr std::string_view kMagic{"SQLite format 3\0", 16};
constexpr std::size_t kReadVersionByte = 19;  // 2: write-ahead log, see sqlite.org/fileformat2
constexpr int kMaxRowBytes = 16 << 20;        // a profile of kSessionMaxPoints fits

bool HasContent(const std::string& path) {
  struct stat status {};
  return stat(path.c_str(), &status) == 0 && status.st_size > 0;
}

std::string UriOf(const std::string& path) {
  constexpr std::string_view kHex = "0123456789ABCDEF";
  std::string uri = "file:";
  for (const unsigned char c : path) {
    if (c == '%' || c == '?' || c == '#') {
      uri += '%';
      uri += kHex[c >> 4U];
      uri += kHex[c & 15U];
    } else {
      uri += static_cast<char>(c);
    }
  }
  return uri + "?immutable=1";
}

// Nothing that a foreign file brings along may run, and no lying length may make us allocate.
void Harden(sqlite3* database) {
  sqlite3_limit(database, SQLITE_LIMIT_LENGTH, kMaxRowBytes);
  sqlite3_db_config(database, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
  sqlite3_db_config(database, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  sqlite3_db_config(database, SQLITE_DBCONFIG_ENABLE_TRIGGER, 0, nullptr);
  sqlite3_db_config(database, SQLITE_DBCONFIG_ENABLE_VIEW, 0, nullptr);
  sqlite3_db_config(database, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr);
  sqlite3_exec(database, "PRAGMA cell_size_check=ON", nullptr, nullptr, nullptr);
}

Result<DatabasePtr> OpenWith(const std::string& name, const std::string& path, int flags,
                             const char* vfs) {
  sqlite3* raw = nullptr;
  const int code = sqlite3_open_v2(name.c_str(), &raw, flags | SQLITE_OPEN_NOMUTEX, vfs);
  DatabasePtr database(raw);
  if (code != SQLITE_OK) return Fail(DatabaseError(raw, path, "cannot open the session"));
  sqlite3_extended_result_codes(raw, 1);
  return database;
}

// Forces the schema to be read, which is when SQLite really opens file and log.
int Touch(sqlite3* database) {
  return sqlite3_exec(database, "SELECT count(*) FROM sqlite_schema", nullptr, nullptr, nullptr);
}

Result<std::array<char, 100>> ReadHeader(const std::string& path) {
  struct stat status {};
  if (stat(path.c_str(), &status) != 0) {
    return Fail(ErrorKind::kBadInput,
                path + ": cannot open the session: " + std::generic_category().message(errno));
  }
  if (!S_ISREG(status.st_mode)) {
    return Fail(ErrorKind::kBadInput, path + ": not a regular file; expected a session file");
  }
  std::array<char, 100> header{};
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    return Fail(ErrorKind::kBadInput,
                path + ": cannot open the session: " + std::generic_category().message(errno));
  }
  file.read(header.data(), header.size());
  const auto size = static_cast<std::size_t>(file.gcount());
  if (size < header.size()) {
    return Fail(ErrorKind::kBadInput, path + ": " + std::to_string(size) +
                                          " bytes; a session has at least a header of 100 bytes");
  }
  if (std::string_view(header.data(), kMagic.size()) != kMagic) {
    return Fail(ErrorKind::kBadInput,
                path + ": byte 0: not a SQLite database; expected a session file");
  }
  return header;
}

}  // namespace

hal::Error DatabaseError(sqlite3* database, const std::string& path, const std::string& what) {
  const int code = database != nullptr ? sqlite3_errcode(database) & 0xff : SQLITE_NOMEM;
  const std::string message = database != nullptr ? sqlite3_errmsg(database) : "out of memory";
  switch (code) {
    case SQLITE_FULL:
    case SQLITE_IOERR:
      return {ErrorKind::kDevice, path + ": " + what + ": " + message + "; check the disk"};
    case SQLITE_NOMEM:
      return {ErrorKind::kInternal, path + ": " + what + ": " + message};
    case SQLITE_TOOBIG:
      return {ErrorKind::kBadInput, path + ": " + what + ": a row of more than " +
                                        std::to_string(kMaxRowBytes) + " bytes; it is damaged"};
    default:
      return {ErrorKind::kBadInput, path + ": " + what + ": " + message};
  }
}

Result<DatabasePtr> OpenSessionReadOnly(const std::string& path) {
  const auto header = ReadHeader(path);
  if (!header) return Fail(header.error());
  const bool has_log = HasContent(path + "-wal");
  const bool has_log_index = HasContent(path + "-shm");
  const bool in_log_mode = (*header)[kReadVersionByte] == 2;

  Result<DatabasePtr> database;
  if (in_log_mode && !has_log) {
    // The log stayed behind: what had been moved into the file counts, and no log is begun.
    database = OpenWith(UriOf(path), path, SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, nullptr);
  } else if (in_log_mode && !has_log_index) {
    // A leftover log of which nobody is the writer: its index is kept in memory, so that this
    // works on read-only media. Exclusive mode needs a lock, which a read-only file cannot give.
    database = OpenWith(path, path, SQLITE_OPEN_READONLY, "unix-none");
    if (database) {
      sqlite3_exec(database->get(), "PRAGMA locking_mode=EXCLUSIVE", nullptr, nullptr, nullptr);
    }
  } else {
    database = OpenWith(path, path, SQLITE_OPEN_READONLY, nullptr);
  }
  if (!database) return database;
  Harden(database->get());
  int code = Touch(database->get());
  if (code == SQLITE_READONLY_ROLLBACK) {
    // Written in rollback mode and cut off: as every reader must, undo the half transaction.
    database = OpenWith(path, path, SQLITE_OPEN_READWRITE, nullptr);
    if (!database) return database;
    Harden(database->get());
    code = Touch(database->get());
  }
  if ((code & 0xff) == SQLITE_CORRUPT) {
    // Shorter than its header says: SQLite then reads on only with this switch. Nothing is written.
    sqlite3_db_config(database->get(), SQLITE_DBCONFIG_DEFENSIVE, 0, nullptr);
    sqlite3_exec(database->get(), "PRAGMA writable_schema=ON", nullptr, nullptr, nullptr);
    code = Touch(database->get());
  }
  if (code != SQLITE_OK) {
    return Fail(DatabaseError(database->get(), path, "cannot read the session"));
  }
  return database;
}

Result<DatabasePtr> OpenSessionForWriting(const std::string& path) {
  return OpenWith(path, path, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, nullptr);
}

Result<StatementPtr> Prepare(sqlite3* database, const std::string& path, const char* sql) {
  sqlite3_stmt* raw = nullptr;
  if (sqlite3_prepare_v3(database, sql, -1, SQLITE_PREPARE_PERSISTENT, &raw, nullptr) !=
      SQLITE_OK) {
    return Fail(DatabaseError(database, path, std::string("cannot run \"") + sql + "\""));
  }
  return StatementPtr(raw);
}

Result<void> Execute(sqlite3* database, const std::string& path, const char* sql) {
  if (sqlite3_exec(database, sql, nullptr, nullptr, nullptr) != SQLITE_OK) {
    return Fail(DatabaseError(database, path, std::string("cannot run \"") + sql + "\""));
  }
  return {};
}

}  // namespace bendloop::drivers
