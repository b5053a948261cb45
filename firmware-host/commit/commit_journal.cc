// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/commit/commit_journal.h"

#include <utility>

#include "firmware-host/commit/journal_file.h"
#include "firmware-host/commit/journal_json.h"

namespace bendloop::host {
namespace {

using hal::ErrorKind;
using Outcome = drivers::Statement::Outcome;

constexpr std::pair<CommitStep, const char*> kSteps[] = {
    {CommitStep::kBegun, "begun"},
    {CommitStep::kCommitting, "committing"},
    {CommitStep::kCommitted, "committed"},
    {CommitStep::kNotCommitted, "not committed"},
    {CommitStep::kFailed, "failed"}};

constexpr char kWriting[] = "the commit journal cannot be written";
constexpr char kReading[] = "the commit journal cannot be read";

const char* StepName(CommitStep step) { return kSteps[static_cast<int>(step)].second; }

hal::Result<void> InsertStep(const drivers::Database& database, std::int64_t attempt,
                             CommitStep step, const std::string& detail) {
  return Write(database, "INSERT INTO step(attempt, unix_ms, step, detail) VALUES(?, ?, ?, ?)",
               attempt, UnixMilliseconds(), StepName(step), detail);
}

hal::Result<void> InsertSequence(const drivers::Database& database, std::uint32_t sequence) {
  return Write(database, "INSERT INTO sequence(number) VALUES(?)", sequence);
}

// Of the row that was stepped to: id, session, base, next, step, detail.
hal::Result<CommitAttempt> AttemptIn(const drivers::Statement& row, const std::string& path) {
  CommitAttempt attempt;
  attempt.id = row.Integer(0);
  attempt.session = row.Text(1);
  const auto base = ProgramFromJson(row.Text(2));
  const auto next = ProgramFromJson(row.Text(3));
  if (!base) return hal::Fail(base.error());
  if (!next) return hal::Fail(next.error());
  attempt.base = *base;
  attempt.next = *next;
  attempt.detail = row.Text(5);
  for (const auto& [step, name] : kSteps) {
    if (row.Text(4) != name) continue;
    attempt.step = step;
    return attempt;
  }
  return hal::Fail(ErrorKind::kBadInput, path + ": unknown step \"" + std::string(row.Text(4)) +
                                             "\" in attempt " + std::to_string(attempt.id));
}

}  // namespace

hal::Result<CommitJournal> CommitJournal::Open(const std::filesystem::path& path) {
  auto database = OpenJournalFile(path);
  if (!database) return hal::Fail(database.error());
  return CommitJournal(std::move(*database));
}

hal::Result<std::int64_t> CommitJournal::Begin(const CommitAttempt& attempt) {
  std::int64_t id = 0;
  const auto written = database_.Transact(kWriting, [&]() -> hal::Result<void> {
    auto done = Write(database_, "INSERT INTO attempt(session, base, next) VALUES(?, ?, ?)",
                      attempt.session, ProgramToJson(attempt.base), ProgramToJson(attempt.next));
    if (!done) return done;
    id = database_.last_id();
    done = InsertSequence(database_, attempt.next.sequence);
    return done ? InsertStep(database_, id, CommitStep::kBegun, attempt.detail) : done;
  });
  if (!written) return hal::Fail(written.error());
  return id;
}

hal::Result<void> CommitJournal::Append(std::int64_t attempt, CommitStep step,
                                        const std::string& detail) {
  return database_.Transact(kWriting, [&] { return InsertStep(database_, attempt, step, detail); });
}

hal::Result<void> CommitJournal::NoteSequence(std::uint32_t sequence) {
  return database_.Transact(kWriting, [&] { return InsertSequence(database_, sequence); });
}

hal::Result<void> CommitJournal::NoteVoid(std::uint32_t sequence) {
  return database_.Transact(kWriting, [&]() -> hal::Result<void> {
    if (auto done = InsertSequence(database_, sequence); !done) return done;
    return Write(database_, "INSERT INTO void(sequence) VALUES(?)", database_.last_id());
  });
}

hal::Result<bool> CommitJournal::IsVoid(std::uint32_t sequence) const {
  auto query = database_.Prepare(
      "SELECT 1 FROM void WHERE sequence = (SELECT max(id) FROM sequence WHERE number = ?)");
  if (!query) return hal::Fail(query.error());
  query->Bind(sequence);
  const Outcome outcome = query->Step();
  if (outcome == Outcome::kFailed) return hal::Fail(database_.Failed(kReading));
  return outcome == Outcome::kRow;
}

hal::Result<void> CommitJournal::NoteBreach(const std::string& cause, const std::string& detail) {
  return database_.Transact(kWriting, [&] {
    return Write(database_, "INSERT OR IGNORE INTO breach(unix_ms, cause, detail) VALUES(?, ?, ?)",
                 UnixMilliseconds(), cause, detail);
  });
}

hal::Result<std::optional<std::string>> CommitJournal::OpenBreach() const {
  auto query = database_.Prepare(
      "SELECT detail FROM breach WHERE id > (SELECT ifnull(max(breach), 0) FROM acknowledgement)"
      " ORDER BY id LIMIT 1");
  if (!query) return hal::Fail(query.error());
  const Outcome outcome = query->Step();
  if (outcome == Outcome::kEnd) return std::nullopt;
  if (outcome != Outcome::kRow) return hal::Fail(database_.Failed(kReading));
  return std::string(query->Text(0));
}

hal::Result<void> CommitJournal::Acknowledge(const std::string& who) {
  return database_.Transact(kWriting, [&] {
    return Write(database_,
                 "INSERT INTO acknowledgement(unix_ms, breach, who)"
                 " SELECT ?, ifnull(max(id), 0), ? FROM breach",
                 UnixMilliseconds(), who);
  });
}

hal::Result<std::optional<CommitAttempt>> CommitJournal::Last() const {
  auto query = database_.Prepare(
      "SELECT attempt.id, session, base, next, step.step, step.detail FROM attempt"
      " JOIN step ON step.attempt = attempt.id"
      " ORDER BY attempt.id DESC, step.id DESC LIMIT 1");
  if (!query) return hal::Fail(query.error());
  const Outcome outcome = query->Step();
  if (outcome == Outcome::kEnd) return std::nullopt;
  if (outcome != Outcome::kRow) return hal::Fail(database_.Failed(kReading));
  auto attempt = AttemptIn(*query, database_.path());
  if (!attempt) return hal::Fail(attempt.error());
  return std::move(*attempt);
}

hal::Result<std::vector<CommitAttempt>> CommitJournal::EndsAfter(std::int64_t attempt) const {
  auto query = database_.Prepare(
      "SELECT attempt.id, session, base, next, step.step, step.detail FROM attempt"
      " JOIN step ON step.attempt = attempt.id"
      " WHERE attempt.id > ? AND step.step NOT IN (?, ?) ORDER BY attempt.id, step.id");
  if (!query) return hal::Fail(query.error());
  query->Bind(attempt).Bind(StepName(CommitStep::kBegun)).Bind(StepName(CommitStep::kCommitting));
  std::vector<CommitAttempt> ends;
  Outcome outcome = Outcome::kRow;
  while ((outcome = query->Step()) == Outcome::kRow) {
    auto end = AttemptIn(*query, database_.path());
    if (!end) return hal::Fail(end.error());
    ends.push_back(std::move(*end));
  }
  if (outcome != Outcome::kEnd) return hal::Fail(database_.Failed(kReading));
  return ends;
}

hal::Result<std::int64_t> CommitJournal::LastEnd() const {
  auto query =
      database_.Prepare("SELECT ifnull(max(attempt), 0) FROM step WHERE step NOT IN (?, ?)");
  if (!query) return hal::Fail(query.error());
  query->Bind(StepName(CommitStep::kBegun)).Bind(StepName(CommitStep::kCommitting));
  if (query->Step() != Outcome::kRow) return hal::Fail(database_.Failed(kReading));
  return query->Integer(0);
}

hal::Result<std::optional<CommitAttempt>> CommitJournal::Unfinished() const {
  auto last = Last();
  if (!last || !*last) return last;
  if (IsEnd((*last)->step)) return std::nullopt;
  return last;
}

hal::Result<bool> CommitJournal::SessionCommitted(const std::string& session) const {
  auto query = database_.Prepare(
      "SELECT count(*) FROM attempt JOIN step ON step.attempt = attempt.id"
      " WHERE session = ? AND step.step = ?");
  if (!query) return hal::Fail(query.error());
  if (query->Bind(session).Bind(StepName(CommitStep::kCommitted)).Step() != Outcome::kRow) {
    return hal::Fail(database_.Failed(kReading));
  }
  return query->Integer(0) > 0;
}

hal::Result<bool> CommitJournal::Proposed(const hal::ProgramBlock& from,
                                          const hal::ProgramBlock& to) const {
  // The two newest: the newest may have been begun, and given up, since.
  auto query = database_.Prepare("SELECT base, next FROM attempt ORDER BY id DESC LIMIT 2");
  if (!query) return hal::Fail(query.error());
  Outcome outcome = Outcome::kRow;
  while ((outcome = query->Step()) == Outcome::kRow) {
    const auto base = ProgramFromJson(query->Text(0));
    const auto next = ProgramFromJson(query->Text(1));
    if (base && next && *base == from && *next == to) return true;
  }
  if (outcome != Outcome::kEnd) return hal::Fail(database_.Failed(kReading));
  return false;
}

hal::Result<unsigned> CommitJournal::LargestPartNumber() const {
  auto query = database_.Prepare(
      "SELECT max(CAST(substr(session, 6) AS INTEGER)) FROM"
      " (SELECT session FROM attempt UNION ALL SELECT session FROM scan)"
      " WHERE session LIKE 'part-%'");
  if (!query) return hal::Fail(query.error());
  if (query->Step() != Outcome::kRow) return hal::Fail(database_.Failed(kReading));
  return static_cast<unsigned>(query->Integer(0));
}

hal::Result<std::uint32_t> CommitJournal::LastSequence() const {
  auto query = database_.Prepare("SELECT number FROM sequence ORDER BY id DESC LIMIT 1");
  if (!query) return hal::Fail(query.error());
  const Outcome outcome = query->Step();
  if (outcome == Outcome::kEnd) return 0u;
  if (outcome != Outcome::kRow) return hal::Fail(database_.Failed(kReading));
  return static_cast<std::uint32_t>(query->Integer(0));
}

}  // namespace bendloop::host
