// SPDX-License-Identifier: Apache-2.0
#include "drivers/sqlite/database.h"

#include <sqlite3.h>

#include <utility>

#include "hal/scope_exit.h"

namespace bendloop::drivers {

using hal::ErrorKind;
using hal::Fail;
using hal::Result;

namespace {

// Enough to find it in the sources: an alarm has it, and a script that makes a database is longer
// than a screen.
std::string CannotRun(std::string_view sql) {
  constexpr std::size_t kMostShown = 60;
  return "cannot run \"" + std::string(sql.substr(0, kMostShown)) +
         (sql.size() > kMostShown ? "..." : "") + "\"";
}

}  // namespace

void Statement::Finalize::operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
void Database::Close::operator()(sqlite3* database) const { sqlite3_close_v2(database); }

Statement& Statement::Bind(std::int64_t number) {
  sqlite3_bind_int64(statement_.get(), ++bound_, number);
  return *this;
}

Statement& Statement::Bind(std::string_view text) {
  // A null pointer would be NULL.
  sqlite3_bind_text64(statement_.get(), ++bound_, text.empty() ? "" : text.data(), text.size(),
                      SQLITE_TRANSIENT, SQLITE_UTF8);
  return *this;
}

Statement& Statement::Bind(std::span<const unsigned char> blob) {
  if (blob.empty()) {
    sqlite3_bind_zeroblob(statement_.get(), ++bound_, 0);
  } else {
    sqlite3_bind_blob64(statement_.get(), ++bound_, blob.data(), blob.size(), SQLITE_STATIC);
  }
  return *this;
}

Statement& Statement::Bind(std::optional<std::int64_t> number) {
  return number ? Bind(*number) : BindNull();
}

Statement& Statement::BindNull() {
  sqlite3_bind_null(statement_.get(), ++bound_);
  return *this;
}

Statement::Outcome Statement::Step() {
  const int code = sqlite3_step(statement_.get());
  return code == SQLITE_ROW    ? Outcome::kRow
         : code == SQLITE_DONE ? Outcome::kEnd
                               : Outcome::kFailed;
}

void Statement::Reset() {
  sqlite3_reset(statement_.get());
  sqlite3_clear_bindings(statement_.get());
  bound_ = 0;
}

Statement::Type Statement::type(int column) const {
  switch (sqlite3_column_type(statement_.get(), column)) {
    case SQLITE_INTEGER:
      return Type::kInteger;
    case SQLITE_FLOAT:
      return Type::kReal;
    case SQLITE_TEXT:
      return Type::kText;
    case SQLITE_BLOB:
      return Type::kBlob;
    default:
      return Type::kNull;
  }
}

std::int64_t Statement::Integer(int column) const {
  return sqlite3_column_int64(statement_.get(), column);
}

std::string_view Statement::Text(int column) const {
  const auto* const text = sqlite3_column_text(statement_.get(), column);
  if (text == nullptr) return {};
  return {reinterpret_cast<const char*>(text),
          static_cast<std::size_t>(sqlite3_column_bytes(statement_.get(), column))};
}

std::span<const unsigned char> Statement::Blob(int column) const {
  // The bytes are asked for first: without memory for them their number is 0.
  const auto* const bytes =
      static_cast<const unsigned char*>(sqlite3_column_blob(statement_.get(), column));
  const auto size = static_cast<std::size_t>(sqlite3_column_bytes(statement_.get(), column));
  return {bytes, bytes == nullptr ? 0 : size};
}

Database::Database(sqlite3* opened, std::string path, DatabaseOptions options)
    : database_(opened), path_(std::move(path)), options_(std::move(options)) {}

Result<Database> Database::Open(const std::string& name, const std::string& path,
                                DatabaseOptions options) {
  using Access = DatabaseOptions::Access;
  int flags = options.access == Access::kRead ? SQLITE_OPEN_READONLY : SQLITE_OPEN_READWRITE;
  if (options.access == Access::kCreate) flags |= SQLITE_OPEN_CREATE;
  if (options.one_thread) flags |= SQLITE_OPEN_NOMUTEX;
  if (options.name_is_uri) flags |= SQLITE_OPEN_URI;
  sqlite3* opened = nullptr;
  const int code = sqlite3_open_v2(name.c_str(), &opened, flags, options.vfs);
  Database database(opened, path, std::move(options));
  if (code != SQLITE_OK) return Fail(database.Failed("cannot be opened"));
  sqlite3_extended_result_codes(opened, 1);
  sqlite3_busy_timeout(opened, static_cast<int>(database.options_.busy_timeout.count()));
  return database;
}

Result<Statement> Database::Prepare(const char* sql) const {
  sqlite3_stmt* prepared = nullptr;
  if (sqlite3_prepare_v3(database_.get(), sql, -1, SQLITE_PREPARE_PERSISTENT, &prepared, nullptr) !=
      SQLITE_OK) {
    return Fail(Failed(CannotRun(sql)));
  }
  return Statement(prepared);
}

Result<void> Database::Execute(const std::string& sql) const {
  if (sqlite3_exec(database_.get(), sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK) {
    return Fail(Failed(CannotRun(sql)));
  }
  return {};
}

Result<std::int64_t> Database::Integer(const char* sql) const {
  auto statement = Prepare(sql);
  if (!statement) return Fail(statement.error());
  if (statement->Step() != Statement::Outcome::kRow) {
    return Fail(Failed(CannotRun(sql)));
  }
  return statement->Integer(0);
}

Result<void> Database::Run(Statement& statement, const std::string& doing) const {
  Result<void> done;
  if (statement.Step() != Statement::Outcome::kEnd) done = Fail(Failed(doing));
  statement.Reset();
  return done;
}

Result<void> Database::Transact(const std::string& doing,
                                const std::function<Result<void>()>& work) const {
  const auto run = [&](const char* sql) -> Result<void> {
    if (sqlite3_exec(database_.get(), sql, nullptr, nullptr, nullptr) == SQLITE_OK) return {};
    return Fail(Failed(doing));
  };
  if (transacts_) {
    return Fail(ErrorKind::kInternal, path_ + ": " + doing + ": within a transaction of our own");
  }
  transacts_ = true;
  const hal::ScopeExit over([this] { transacts_ = false; });
  // What could not be rolled back before: that, too, wants memory.
  if (in_transaction()) {
    if (auto ended = run("ROLLBACK"); !ended) return ended;
  }
  // IMMEDIATE: whoever else writes is waited for now and not in the middle.
  if (auto begun = run("BEGIN IMMEDIATE"); !begun) return begun;
  Result<void> done;
  try {
    done = work();
  } catch (...) {  // out of memory
    sqlite3_exec(database_.get(), "ROLLBACK", nullptr, nullptr, nullptr);
    throw;
  }
  if (done) done = run("COMMIT");
  if (!done) sqlite3_exec(database_.get(), "ROLLBACK", nullptr, nullptr, nullptr);
  return done;
}

std::int64_t Database::last_id() const { return sqlite3_last_insert_rowid(database_.get()); }

bool Database::in_transaction() const { return sqlite3_get_autocommit(database_.get()) == 0; }

hal::Error Database::Failed(const std::string& doing) const {
  const int code = database_ ? sqlite3_errcode(database_.get()) & 0xff : SQLITE_NOMEM;
  const std::string where = path_ + ": " + doing + ": ";
  const std::string why = database_ ? sqlite3_errmsg(database_.get()) : "out of memory";
  switch (code) {
    case SQLITE_FULL:
    case SQLITE_IOERR:
      return {ErrorKind::kDevice, where + why + "; check the disk"};
    case SQLITE_NOMEM:
      return {ErrorKind::kInternal, where + why};
    case SQLITE_TOOBIG:
      return {ErrorKind::kBadInput,
              where + "a row of more than " +
                  std::to_string(sqlite3_limit(database_.get(), SQLITE_LIMIT_LENGTH, -1)) +
                  " bytes; it is damaged"};
    case SQLITE_NOTADB:
    case SQLITE_CORRUPT:
      return {ErrorKind::kBadInput, where + why + options_.mend_damage};
    default:
      return {options_.otherwise, where + why};
  }
}

}  // namespace bendloop::drivers
