// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/commit/commit_journal.h"

#include <sqlite3.h>

#include <chrono>
#include <utility>

#include "firmware-host/commit/journal_json.h"

namespace bendloop::host {
namespace {

using hal::ErrorKind;

constexpr int kApplicationId = 0x424C434A;  // "BLCJ"
constexpr int kBusyMs = 2000;

constexpr char kSchema[] =
    "BEGIN IMMEDIATE;"
    "CREATE TABLE IF NOT EXISTS attempt(id INTEGER PRIMARY KEY, session TEXT NOT NULL,"
    " base TEXT NOT NULL, next TEXT NOT NULL);"
    "CREATE TABLE IF NOT EXISTS step(id INTEGER PRIMARY KEY, attempt INTEGER NOT NULL,"
    " unix_ms INTEGER NOT NULL, step TEXT NOT NULL, detail TEXT NOT NULL);"
    "CREATE TABLE IF NOT EXISTS sequence(id INTEGER PRIMARY KEY, number INTEGER NOT NULL);"
    "CREATE INDEX IF NOT EXISTS attempt_session ON attempt(session);"
    "CREATE INDEX IF NOT EXISTS step_attempt ON step(attempt);"
    "PRAGMA user_version = 1;"
    "COMMIT;";

constexpr std::pair<CommitStep, const char*> kSteps[] = {
    {CommitStep::kBegun, "begun"},
    {CommitStep::kCommitting, "committing"},
    {CommitStep::kCommitted, "committed"},
    {CommitStep::kNotCommitted, "not committed"}};

const char* StepName(CommitStep step) { return kSteps[static_cast<int>(step)].second; }

hal::Error SqlError(sqlite3* db, const char* doing) {
  const int code = sqlite3_errcode(db);
  const bool not_ours = code == SQLITE_NOTADB || code == SQLITE_CORRUPT;
  return {not_ours ? ErrorKind::kBadInput : ErrorKind::kInternal,
          std::string("commit journal: cannot ") + doing + ": " + sqlite3_errmsg(db)};
}

// A prepared statement; text and blobs are copied in and out.
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
  int Step() { return prepared_ ? sqlite3_step(statement_) : SQLITE_ERROR; }
  std::string Text(int column) {
    const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement_, column));
    return text == nullptr ? std::string() : std::string(text);
  }
  std::int64_t Integer(int column) { return sqlite3_column_int64(statement_, column); }

 private:
  sqlite3_stmt* statement_ = nullptr;
  bool prepared_ = false;
  int bound_ = 0;
};

std::int64_t UnixMilliseconds() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::milliseconds>(now).count();
}

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

bool InsertStep(sqlite3* db, std::int64_t attempt, CommitStep step, const std::string& detail) {
  return Statement(db, "INSERT INTO step(attempt, unix_ms, step, detail) VALUES(?, ?, ?, ?)")
             .Bind(attempt)
             .Bind(UnixMilliseconds())
             .Bind(StepName(step))
             .Bind(detail)
             .Step() == SQLITE_DONE;
}

bool InsertSequence(sqlite3* db, std::uint32_t sequence) {
  return Statement(db, "INSERT INTO sequence(number) VALUES(?)")
             .Bind(std::int64_t{sequence})
             .Step() == SQLITE_DONE;
}

}  // namespace

hal::Result<CommitJournal> CommitJournal::Open(const std::filesystem::path& path) {
  sqlite3* db = nullptr;
  const int opened = sqlite3_open(path.c_str(), &db);
  CommitJournal journal(db);  // closes, whatever comes
  const auto named = [&path](hal::Error error) {
    error.message += " (" + path.string() + ")";
    return hal::Fail(std::move(error));
  };
  if (opened != SQLITE_OK) return named(SqlError(db, "open the file"));
  sqlite3_busy_timeout(db, kBusyMs);
  {
    Statement id(db, "PRAGMA application_id");
    if (id.Step() != SQLITE_ROW) return named(SqlError(db, "read the file"));
    Statement tables(db, "SELECT count(*) FROM sqlite_master");
    if (tables.Step() != SQLITE_ROW) return named(SqlError(db, "read the file"));
    if (id.Integer(0) != kApplicationId && tables.Integer(0) != 0) {
      return hal::Fail(ErrorKind::kBadInput, "commit journal " + path.string() +
                                                 ": a database of something else; expected "
                                                 "application_id 0x424C434A or a new file");
    }
  }
  const std::string pragmas = "PRAGMA application_id = " + std::to_string(kApplicationId) +
                              "; PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL;";
  if (sqlite3_exec(db, pragmas.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK ||
      sqlite3_exec(db, kSchema, nullptr, nullptr, nullptr) != SQLITE_OK) {
    return named(SqlError(db, "prepare the file"));
  }
  return journal;
}

CommitJournal::CommitJournal(CommitJournal&& other) noexcept
    : db_(std::exchange(other.db_, nullptr)) {}

CommitJournal& CommitJournal::operator=(CommitJournal&& other) noexcept {
  std::swap(db_, other.db_);
  return *this;
}

CommitJournal::~CommitJournal() { sqlite3_close(db_); }

hal::Result<std::int64_t> CommitJournal::Begin(const CommitAttempt& attempt) {
  std::int64_t id = 0;
  const auto written = InTransaction(db_, "write an attempt", [&] {
    if (Statement(db_, "INSERT INTO attempt(session, base, next) VALUES(?, ?, ?)")
            .Bind(attempt.session)
            .Bind(ProgramToJson(attempt.base))
            .Bind(ProgramToJson(attempt.next))
            .Step() != SQLITE_DONE) {
      return false;
    }
    id = sqlite3_last_insert_rowid(db_);
    return InsertSequence(db_, attempt.next.sequence) &&
           InsertStep(db_, id, CommitStep::kBegun, attempt.detail);
  });
  if (!written) return hal::Fail(written.error());
  return id;
}

hal::Result<void> CommitJournal::Append(std::int64_t attempt, CommitStep step,
                                        const std::string& detail) {
  return InTransaction(db_, "write a step", [&] { return InsertStep(db_, attempt, step, detail); });
}

hal::Result<void> CommitJournal::NoteSequence(std::uint32_t sequence) {
  return InTransaction(db_, "write a sequence number",
                       [&] { return InsertSequence(db_, sequence); });
}

hal::Result<std::optional<CommitAttempt>> CommitJournal::Last() const {
  Statement query(db_,
                  "SELECT attempt.id, session, base, next, step.step, step.detail FROM attempt"
                  " JOIN step ON step.attempt = attempt.id"
                  " ORDER BY attempt.id DESC, step.id DESC LIMIT 1");
  const int code = query.Step();
  if (code == SQLITE_DONE) return std::nullopt;
  if (code != SQLITE_ROW) return hal::Fail(SqlError(db_, "read"));
  CommitAttempt attempt;
  attempt.id = query.Integer(0);
  attempt.session = query.Text(1);
  const auto base = ProgramFromJson(query.Text(2));
  const auto next = ProgramFromJson(query.Text(3));
  if (!base) return hal::Fail(base.error());
  if (!next) return hal::Fail(next.error());
  attempt.base = *base;
  attempt.next = *next;
  attempt.detail = query.Text(5);
  for (const auto& [step, name] : kSteps) {
    if (query.Text(4) != name) continue;
    attempt.step = step;
    return attempt;
  }
  return hal::Fail(ErrorKind::kBadInput, "commit journal: unknown step \"" + query.Text(4) +
                                             "\" in attempt " + std::to_string(attempt.id));
}

hal::Result<std::optional<CommitAttempt>> CommitJournal::Unfinished() const {
  auto last = Last();
  if (!last || !*last) return last;
  const CommitStep step = (*last)->step;
  if (step == CommitStep::kCommitted || step == CommitStep::kNotCommitted) return std::nullopt;
  return last;
}

hal::Result<bool> CommitJournal::SessionCommitted(const std::string& session) const {
  Statement query(db_,
                  "SELECT count(*) FROM attempt JOIN step ON step.attempt = attempt.id"
                  " WHERE session = ? AND step.step = ?");
  if (query.Bind(session).Bind(StepName(CommitStep::kCommitted)).Step() != SQLITE_ROW) {
    return hal::Fail(SqlError(db_, "read"));
  }
  return query.Integer(0) > 0;
}

hal::Result<std::uint32_t> CommitJournal::LastSequence() const {
  Statement query(db_, "SELECT number FROM sequence ORDER BY id DESC LIMIT 1");
  const int code = query.Step();
  if (code == SQLITE_DONE) return 0u;
  if (code != SQLITE_ROW) return hal::Fail(SqlError(db_, "read"));
  return static_cast<std::uint32_t>(query.Integer(0));
}

}  // namespace bendloop::host
