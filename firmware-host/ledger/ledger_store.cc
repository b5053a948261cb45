// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/ledger/ledger_store.h"

#include <algorithm>
#include <utility>

#include "firmware-host/commit/journal_file.h"
#include "firmware-host/commit/journal_json.h"

namespace bendloop::host {
namespace {

using Outcome = drivers::Statement::Outcome;
using Type = drivers::Statement::Type;

constexpr char kWriting[] = "the tube ledger cannot be written";
constexpr char kReading[] = "the tube ledger cannot be read";
constexpr char kInsertScan[] =
    "INSERT INTO scan(unix_ms, session, tube, state, detail) VALUES(?, ?, ?, ?, ?)";

}  // namespace

const char* Name(ScanFate fate) {
  switch (fate) {
    case ScanFate::kHeld:
      return "held";
    case ScanFate::kUsed:
      return "used";
    case ScanFate::kWaiting:
      return "waiting";
    case ScanFate::kCorrected:
      return "corrected";
    case ScanFate::kUnknown:
      return "unknown";
    case ScanFate::kDone:
      break;
  }
  return "done";
}

hal::Result<LedgerStore> LedgerStore::Open(const std::filesystem::path& path) {
  auto database = OpenJournalFile(path);
  if (!database) return hal::Fail(database.error());
  return LedgerStore(std::move(*database));
}

hal::Result<std::int64_t> LedgerStore::RowOf(const hal::ProgramBlock& program) {
  const std::string block = ProgramToJson(program);
  if (auto done = Write(database_, "INSERT OR IGNORE INTO program(block) VALUES(?)", block);
      !done) {
    return hal::Fail(done.error());
  }
  auto row = database_.Prepare("SELECT id FROM program WHERE block = ?");
  if (!row) return hal::Fail(row.error());
  if (row->Bind(block).Step() != Outcome::kRow) return hal::Fail(database_.Failed(kReading));
  return row->Integer(0);
}

hal::Result<void> LedgerStore::Insert(BentTube& tube) {
  std::optional<std::int64_t> program;
  if (tube.program) {
    const auto row = RowOf(*tube.program);
    if (!row) return hal::Fail(row.error());
    program = *row;
  }
  auto done = Write(database_,
                    "INSERT INTO tube(unix_ms, count, program, epoch, doubt)"
                    " VALUES(?, ?, ?, ?, ?)",
                    UnixMilliseconds(), std::optional<std::int64_t>(tube.count), program,
                    static_cast<std::int64_t>(tube.epoch), tube.doubt);
  if (done) tube.id = database_.last_id();
  return done;
}

hal::Result<void> LedgerStore::Append(const BenderChange& change, std::vector<BentTube>& tubes) {
  return database_.Transact(kWriting, [&]() -> hal::Result<void> {
    const auto program = RowOf(change.active);
    if (!program) return hal::Fail(program.error());
    auto done = Write(database_,
                      "INSERT INTO change(unix_ms, parts_bent, program, epoch, what)"
                      " VALUES(?, ?, ?, ?, ?)",
                      UnixMilliseconds(), change.parts_bent, *program,
                      static_cast<std::int64_t>(change.epoch), change.what);
    for (std::size_t i = 0; done && i < tubes.size(); ++i) done = Insert(tubes[i]);
    return done;
  });
}

hal::Result<void> LedgerStore::Append(const std::string& session, std::optional<std::int64_t> tube,
                                      ScanFate fate, const std::string& detail) {
  return database_.Transact(kWriting, [&] {
    return Write(database_, kInsertScan, UnixMilliseconds(), session, tube, Name(fate), detail);
  });
}

hal::Result<void> LedgerStore::InsertUse(const std::string& session, std::int64_t tube,
                                         const std::string& detail,
                                         const std::optional<TubeName>& name) {
  auto done = Write(database_, kInsertScan, UnixMilliseconds(), session, tube,
                    Name(ScanFate::kUsed), detail);
  if (!done || !name) return done;
  return Write(database_,
               "INSERT INTO name(unix_ms, session, part_number, name) VALUES(?, ?, ?, ?)",
               UnixMilliseconds(), session, name->part_number, name->name);
}

hal::Result<void> LedgerStore::AppendUse(const std::string& session, std::int64_t tube,
                                         const std::string& detail,
                                         const std::optional<TubeName>& name) {
  return database_.Transact(kWriting, [&] { return InsertUse(session, tube, detail, name); });
}

hal::Result<void> LedgerStore::AppendUse(const std::string& session, BentTube& tube,
                                         const std::optional<TubeName>& name) {
  return database_.Transact(kWriting, [&]() -> hal::Result<void> {
    if (auto done = Insert(tube); !done) return done;
    return InsertUse(session, tube.id, "", name);
  });
}

hal::Result<std::optional<std::string>> LedgerStore::SessionOf(const TubeName& name,
                                                               const std::string& session) const {
  auto query = database_.Prepare(
      "SELECT session FROM name WHERE name = ? AND part_number = ? AND session <> ?"
      " ORDER BY id DESC LIMIT 1");
  if (!query) return hal::Fail(query.error());
  const Outcome outcome =
      query->Bind(name.name).Bind(std::int64_t{name.part_number}).Bind(session).Step();
  if (outcome == Outcome::kEnd) return std::nullopt;
  if (outcome != Outcome::kRow) return hal::Fail(database_.Failed(kReading));
  return std::string(query->Text(0));
}

hal::Result<std::optional<TubeName>> LedgerStore::NameOf(const std::string& session) const {
  auto query = database_.Prepare(
      "SELECT part_number, name FROM name WHERE session = ? ORDER BY id DESC LIMIT 1");
  if (!query) return hal::Fail(query.error());
  const Outcome outcome = query->Bind(session).Step();
  if (outcome == Outcome::kEnd) return std::nullopt;
  if (outcome != Outcome::kRow) return hal::Fail(database_.Failed(kReading));
  return TubeName{static_cast<std::uint32_t>(query->Integer(0)), std::string(query->Text(1))};
}

hal::Result<std::optional<BenderChange>> LedgerStore::LastChange() const {
  auto query = database_.Prepare(
      "SELECT parts_bent, block, epoch, what FROM change JOIN program"
      " ON program.id = change.program ORDER BY change.id DESC LIMIT 1");
  if (!query) return hal::Fail(query.error());
  const Outcome outcome = query->Step();
  if (outcome == Outcome::kEnd) return std::nullopt;
  if (outcome != Outcome::kRow) return hal::Fail(database_.Failed(kReading));
  const auto active = ProgramFromJson(query->Text(1));
  if (!active) return hal::Fail(active.error());
  return BenderChange{static_cast<std::uint32_t>(query->Integer(0)), *active,
                      static_cast<std::uint64_t>(query->Integer(2)), std::string(query->Text(3))};
}

hal::Result<std::vector<BentTube>> LedgerStore::Tubes(std::size_t count) const {
  // Used up: by a scan of its own, or passed over by one of a later tube.
  auto query = database_.Prepare(
      "SELECT tube.id, count, block, epoch, doubt,"
      " (SELECT max(session) FROM scan WHERE scan.tube = tube.id AND state = 'used'),"
      " tube.id <= (SELECT coalesce(max(tube), 0) FROM scan WHERE state = 'used')"
      " FROM tube LEFT JOIN program ON program.id = tube.program"
      " WHERE tube.id >= (SELECT coalesce(max(id), 0) FROM tube WHERE doubt LIKE ?)"
      " ORDER BY tube.id DESC LIMIT ?");
  if (!query) return hal::Fail(query.error());
  query->Bind(std::string(kCountJumped) + "%").Bind(static_cast<std::int64_t>(count));
  std::vector<BentTube> tubes;
  Outcome outcome = Outcome::kRow;
  while ((outcome = query->Step()) == Outcome::kRow) {
    BentTube tube;
    tube.id = query->Integer(0);
    if (query->type(1) != Type::kNull) tube.count = static_cast<std::uint32_t>(query->Integer(1));
    if (query->type(2) != Type::kNull) {
      auto program = ProgramFromJson(query->Text(2));
      if (!program) return hal::Fail(program.error());
      tube.program = std::move(*program);
    }
    tube.epoch = static_cast<std::uint64_t>(query->Integer(3));
    tube.doubt = query->Text(4);
    tube.session = query->Text(5);
    tube.used = query->Integer(6) != 0;
    tubes.push_back(std::move(tube));
  }
  if (outcome != Outcome::kEnd) return hal::Fail(database_.Failed(kReading));
  std::reverse(tubes.begin(), tubes.end());
  return tubes;
}

hal::Result<std::vector<std::string>> LedgerStore::Sessions(ScanFate fate) const {
  auto query = database_.Prepare(
      "SELECT session FROM scan WHERE state = ? AND id IN"
      " (SELECT max(id) FROM scan GROUP BY session) ORDER BY id");
  if (!query) return hal::Fail(query.error());
  query->Bind(std::string(Name(fate)));
  std::vector<std::string> sessions;
  Outcome outcome = Outcome::kRow;
  while ((outcome = query->Step()) == Outcome::kRow) sessions.emplace_back(query->Text(0));
  if (outcome != Outcome::kEnd) return hal::Fail(database_.Failed(kReading));
  return sessions;
}

}  // namespace bendloop::host
