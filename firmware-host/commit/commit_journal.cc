// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/commit/commit_journal.h"

#include <sqlite3.h>

#include <utility>

#include "firmware-host/commit/journal_file.h"
#include "firmware-host/commit/journal_json.h"

namespace bendloop::host {
namespace {

using hal::ErrorKind;

constexpr std::pair<CommitStep, const char*> kSteps[] = {
    {CommitStep::kBegun, "begun"},
    {CommitStep::kCommitting, "committing"},
    {CommitStep::kCommitted, "committed"},
    {CommitStep::kNotCommitted, "not committed"}};

const char* StepName(CommitStep step) { return kSteps[static_cast<int>(step)].second; }

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
  auto db = OpenJournalFile(path);
  if (!db) return hal::Fail(db.error());
  return CommitJournal(*db);
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

hal::Result<bool> CommitJournal::Proposed(const hal::ProgramBlock& from,
                                          const hal::ProgramBlock& to) const {
  // The two newest: the newest may have been begun, and given up, since.
  Statement query(db_, "SELECT base, next FROM attempt ORDER BY id DESC LIMIT 2");
  int code = SQLITE_ROW;
  while ((code = query.Step()) == SQLITE_ROW) {
    const auto base = ProgramFromJson(query.Text(0));
    const auto next = ProgramFromJson(query.Text(1));
    if (base && next && *base == from && *next == to) return true;
  }
  if (code != SQLITE_DONE) return hal::Fail(SqlError(db_, "read"));
  return false;
}

hal::Result<unsigned> CommitJournal::LargestPartNumber() const {
  Statement query(db_,
                  "SELECT max(CAST(substr(session, 6) AS INTEGER)) FROM"
                  " (SELECT session FROM attempt UNION ALL SELECT session FROM scan)"
                  " WHERE session LIKE 'part-%'");
  if (query.Step() != SQLITE_ROW) return hal::Fail(SqlError(db_, "read"));
  return static_cast<unsigned>(query.Integer(0));
}

hal::Result<std::uint32_t> CommitJournal::LastSequence() const {
  Statement query(db_, "SELECT number FROM sequence ORDER BY id DESC LIMIT 1");
  const int code = query.Step();
  if (code == SQLITE_DONE) return 0u;
  if (code != SQLITE_ROW) return hal::Fail(SqlError(db_, "read"));
  return static_cast<std::uint32_t>(query.Integer(0));
}

}  // namespace bendloop::host
