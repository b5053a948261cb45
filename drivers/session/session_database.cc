// SPDX-License-Identifier: Apache-2.0
#include "drivers/session/session_database.h"

#include <sqlite3.h>
#include <sys/stat.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string_view>
#include <system_error>

#include "drivers/session/session_format.h"

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using hal::Fail;
using hal::Result;

constexpr std::string_view kMagic{"SQLite format 3\0", 16};
constexpr std::size_t kReadVersionByte = 19;  // 2: write-ahead log, see sqlite.org/fileformat2
constexpr std::size_t kPageBytesByte = 16;    // u16; 1: 65536
constexpr std::size_t kPagesByte = 28;
constexpr std::size_t kApplicationIdByte = 68;
constexpr int kMaxRowBytes = 16 << 20;  // a profile of kSessionMaxPoints fits

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

// A session may come from anywhere: what SQLite finds wrong is wrong with the file.
DatabaseOptions Options(DatabaseOptions::Access access) {
  return {.access = access, .one_thread = true, .otherwise = ErrorKind::kBadInput};
}

// Forces the schema to be read, which is when SQLite really opens file and log.
int Touch(const Database& database) {
  return sqlite3_exec(database.handle(), "SELECT count(*) FROM sqlite_schema", nullptr, nullptr,
                      nullptr);
}

std::uint32_t BigEndian(const std::array<char, 100>& header, std::size_t at, std::size_t bytes) {
  std::uint32_t number = 0;
  for (std::size_t i = 0; i < bytes; ++i) {
    number = number << 8U | static_cast<unsigned char>(header[at + i]);
  }
  return number;
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

Result<Database> OpenSessionReadOnly(const std::string& path) {
  const auto header = ReadHeader(path);
  if (!header) return Fail(header.error());
  const bool has_log = HasContent(path + "-wal");
  const bool has_log_index = HasContent(path + "-shm");
  const bool in_log_mode = (*header)[kReadVersionByte] == 2;

  std::string name = path;
  DatabaseOptions options = Options(DatabaseOptions::Access::kRead);
  options.mend_damage = MendOfSession(path);
  const bool has_lonely_log = in_log_mode && has_log && !has_log_index;
  if (in_log_mode && !has_log) {
    // The log stayed behind: what had been moved into the file counts, and no log is begun.
    name = UriOf(path);
    options.name_is_uri = true;
  } else if (has_lonely_log) {
    // Of which nobody is the writer: its index is kept in memory, so that this works on read-only
    // media. Exclusive mode needs a lock, which a read-only file cannot give.
    options.vfs = "unix-none";
  }
  auto database = Database::Open(name, path, options);
  if (!database) return database;
  if (has_lonely_log) (void)database->Execute("PRAGMA locking_mode=EXCLUSIVE");
  Harden(database->handle());
  int code = Touch(*database);
  if (code == SQLITE_READONLY_ROLLBACK) {
    // Written in rollback mode and cut off: as every reader must, undo the half transaction.
    database = Database::Open(path, path, Options(DatabaseOptions::Access::kWrite));
    if (!database) return database;
    Harden(database->handle());
    code = Touch(*database);
  }
  if ((code & 0xff) == SQLITE_CORRUPT) {
    // Shorter than its header says: SQLite then reads on only with this switch. Nothing is written.
    sqlite3_db_config(database->handle(), SQLITE_DBCONFIG_DEFENSIVE, 0, nullptr);
    (void)database->Execute("PRAGMA writable_schema=ON");
    code = Touch(*database);
  }
  if (code != SQLITE_OK) return Fail(database->Failed("cannot read the session"));
  return database;
}

bool LooksLikeDatabase(const std::string& path) { return ReadHeader(path).has_value(); }

bool LooksLikeSession(const std::string& path) {
  const auto header = ReadHeader(path);
  if (!header) return false;
  return BigEndian(*header, kApplicationIdByte, 4) == kSessionApplicationId;
}

std::string MendOfSession(const std::string& path) {
  std::error_code error;
  const std::uintmax_t bytes = std::filesystem::file_size(path, error);
  if (const auto header = ReadHeader(path); header && !error) {
    const std::uint32_t page = BigEndian(*header, kPageBytesByte, 2);
    const std::uintmax_t expected =
        std::uintmax_t{page == 1 ? 65536 : page} * BigEndian(*header, kPagesByte, 4);
    if (bytes < expected) {
      return "; the file ends after byte " + std::to_string(bytes) + " of " +
             std::to_string(expected) + ": copy it again";
    }
  }
  return "; copy it again, and the log beside it (-wal) if there is one";
}

Result<Database> OpenSessionForWriting(const std::string& path) {
  return Database::Open(path, path, Options(DatabaseOptions::Access::kCreate));
}

}  // namespace bendloop::drivers
