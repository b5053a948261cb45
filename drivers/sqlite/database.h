// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "hal/error.h"
#include "hal/result.h"

struct sqlite3;
struct sqlite3_stmt;

// SQLite for all who keep a file: sessions, history, commit journal and ledger. Of our own and
// small, because the C++ wrappers throw, and a damaged session is read on after an error.
namespace bendloop::drivers {

// A prepared statement. It must not outlive its database.
class Statement {
 public:
  enum class Type : std::uint8_t { kInteger, kReal, kText, kBlob, kNull };
  enum class Outcome : std::uint8_t { kRow, kEnd, kFailed };

  Statement() = default;
  explicit Statement(sqlite3_stmt* prepared) : statement_(prepared) {}
  explicit operator bool() const { return statement_ != nullptr; }

  // The next parameter, in the order of the question marks.
  Statement& Bind(std::int64_t number);
  Statement& Bind(std::string_view text);
  Statement& Bind(std::span<const unsigned char> blob);  // must live until the step
  Statement& Bind(std::optional<std::int64_t> number);   // empty: NULL
  Statement& BindNull();

  // To the next row.
  Outcome Step();
  // Ready to be bound and stepped anew.
  void Reset();

  // Columns of the row that was stepped to; views are good until the next step.
  Type type(int column) const;
  std::int64_t Integer(int column) const;
  std::string_view Text(int column) const;
  std::span<const unsigned char> Blob(int column) const;

 private:
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const;
  };
  std::unique_ptr<sqlite3_stmt, Finalize> statement_;
  int bound_ = 0;
};

struct DatabaseOptions {
  enum class Access : std::uint8_t { kRead, kWrite, kCreate };  // each can what those before it can
  Access access = Access::kCreate;
  bool one_thread = false;  // only one thread ever calls
  // How long a call waits for another process that writes.
  std::chrono::milliseconds busy_timeout{0};
  // Kind of the errors that are neither a damaged file (kBadInput), nor the disk's (kDevice), nor
  // for want of memory (kInternal). kBadInput where the file is a stranger's.
  hal::ErrorKind otherwise = hal::ErrorKind::kInternal;
  std::string mend_damage = {};  // "; move it away", said of a damaged file
  const char* vfs = nullptr;     // SQLite's way to the file system; null: the usual one
  bool name_is_uri = false;      // sqlite.org/uri.html
};

// One connection to a SQLite file. Errors name the file, what was being done and SQLite's words.
class Database {
 public:
  Database() = default;  // none
  explicit operator bool() const { return database_ != nullptr; }

  // `name`: what SQLite opens, usually the path, ":memory:" for tests. `path`: what errors name.
  static hal::Result<Database> Open(const std::string& name, const std::string& path,
                                    DatabaseOptions options = {});

  hal::Result<Statement> Prepare(const char* sql) const;
  // One statement or more, without rows.
  hal::Result<void> Execute(const std::string& sql) const;
  // The one number that `sql` gives.
  hal::Result<std::int64_t> Integer(const char* sql) const;
  // Runs a bound statement to its end and makes it ready for the next values.
  hal::Result<void> Run(Statement& statement, const std::string& doing) const;
  // What `work` does reaches the disk together or not at all. Within `work` it fails and leaves the
  // outer transaction as it is.
  hal::Result<void> Transact(const std::string& doing,
                             const std::function<hal::Result<void>()>& work) const;

  std::int64_t last_id() const;  // of the row that was inserted last
  bool in_transaction() const;
  // The error of the last call.
  hal::Error Failed(const std::string& doing) const;
  sqlite3* handle() const { return database_.get(); }
  const std::string& path() const { return path_; }

 private:
  struct Close {
    void operator()(sqlite3* database) const;
  };
  Database(sqlite3* opened, std::string path, DatabaseOptions options);

  std::unique_ptr<sqlite3, Close> database_;
  std::string path_;
  DatabaseOptions options_;
  mutable bool transacts_ = false;
};

}  // namespace bendloop::drivers
