// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/ledger/ledger_store.h"

#include <algorithm>
#include <utility>

#include "firmware-host/commit/journal_file.h"
#include "firmware-host/commit/journal_json.h"

namespace bendloop::host {

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
  auto db = OpenJournalFile(path);
  if (!db) return hal::Fail(db.error());
  return LedgerStore(*db);
}

LedgerStore::LedgerStore(LedgerStore&& other) noexcept : db_(std::exchange(other.db_, nullptr)) {}

LedgerStore& LedgerStore::operator=(LedgerStore&& other) noexcept {
  std::swap(db_, other.db_);
  return *this;
}

LedgerStore::~LedgerStore() { sqlite3_close(db_); }

std::optional<std::int64_t> LedgerStore::RowOf(const hal::ProgramBlock& program) {
  const std::string block = ProgramToJson(program);
  if (Statement(db_, "INSERT OR IGNORE INTO program(block) VALUES(?)").Bind(block).Step() !=
      SQLITE_DONE) {
    return std::nullopt;
  }
  Statement row(db_, "SELECT id FROM program WHERE block = ?");
  if (row.Bind(block).Step() != SQLITE_ROW) return std::nullopt;
  return row.Integer(0);
}

bool LedgerStore::Insert(BentTube& tube) {
  std::optional<std::int64_t> program;
  if (tube.program) {
    program = RowOf(*tube.program);
    if (!program) return false;
  }
  Statement insert(db_,
                   "INSERT INTO tube(unix_ms, count, program, epoch, doubt) VALUES(?, ?, ?, ?, ?)");
  insert.Bind(UnixMilliseconds());
  tube.count ? insert.Bind(std::int64_t{*tube.count}) : insert.BindNull();
  program ? insert.Bind(*program) : insert.BindNull();
  insert.Bind(static_cast<std::int64_t>(tube.epoch)).Bind(tube.doubt);
  if (insert.Step() != SQLITE_DONE) return false;
  tube.id = sqlite3_last_insert_rowid(db_);
  return true;
}

hal::Result<void> LedgerStore::Append(const BenderChange& change, std::vector<BentTube>& tubes) {
  return InTransaction(db_, "write a change of the bender", [&] {
    const auto program = RowOf(change.active);
    return program &&
           Statement(db_,
                     "INSERT INTO change(unix_ms, parts_bent, program, epoch, what)"
                     " VALUES(?, ?, ?, ?, ?)")
                   .Bind(UnixMilliseconds())
                   .Bind(std::int64_t{change.parts_bent})
                   .Bind(*program)
                   .Bind(static_cast<std::int64_t>(change.epoch))
                   .Bind(change.what)
                   .Step() == SQLITE_DONE &&
           std::all_of(tubes.begin(), tubes.end(), [&](BentTube& tube) { return Insert(tube); });
  });
}

hal::Result<void> LedgerStore::Append(const std::string& session, std::optional<std::int64_t> tube,
                                      ScanFate fate, const std::string& detail, BentTube* bent) {
  return InTransaction(db_, "write a scan", [&] {
    if (bent != nullptr) {
      if (!Insert(*bent)) return false;
      tube = bent->id;
    }
    Statement insert(db_,
                     "INSERT INTO scan(unix_ms, session, tube, state, detail)"
                     " VALUES(?, ?, ?, ?, ?)");
    insert.Bind(UnixMilliseconds()).Bind(session);
    tube ? insert.Bind(*tube) : insert.BindNull();
    return insert.Bind(std::string(Name(fate))).Bind(detail).Step() == SQLITE_DONE;
  });
}

hal::Result<std::optional<BenderChange>> LedgerStore::LastChange() const {
  Statement query(db_,
                  "SELECT parts_bent, block, epoch, what FROM change JOIN program"
                  " ON program.id = change.program ORDER BY change.id DESC LIMIT 1");
  const int code = query.Step();
  if (code == SQLITE_DONE) return std::nullopt;
  if (code != SQLITE_ROW) return hal::Fail(SqlError(db_, "read the last change"));
  const auto active = ProgramFromJson(query.Text(1));
  if (!active) return hal::Fail(active.error());
  return BenderChange{static_cast<std::uint32_t>(query.Integer(0)), *active,
                      static_cast<std::uint64_t>(query.Integer(2)), query.Text(3)};
}

hal::Result<std::vector<BentTube>> LedgerStore::Tubes(std::size_t count) const {
  // Used up: by a scan of its own, or passed over by one of a later tube.
  Statement query(db_,
                  "SELECT tube.id, count, block, epoch, doubt,"
                  " (SELECT max(session) FROM scan WHERE scan.tube = tube.id AND state = 'used'),"
                  " tube.id <= (SELECT coalesce(max(tube), 0) FROM scan WHERE state = 'used')"
                  " FROM tube LEFT JOIN program ON program.id = tube.program"
                  " WHERE tube.id >= (SELECT coalesce(max(id), 0) FROM tube WHERE doubt LIKE ?)"
                  " ORDER BY tube.id DESC LIMIT ?");
  query.Bind(std::string(kCountJumped) + "%").Bind(static_cast<std::int64_t>(count));
  std::vector<BentTube> tubes;
  int code = SQLITE_ROW;
  while ((code = query.Step()) == SQLITE_ROW) {
    BentTube tube;
    tube.id = query.Integer(0);
    if (!query.IsNull(1)) tube.count = static_cast<std::uint32_t>(query.Integer(1));
    if (!query.IsNull(2)) {
      auto program = ProgramFromJson(query.Text(2));
      if (!program) return hal::Fail(program.error());
      tube.program = std::move(*program);
    }
    tube.epoch = static_cast<std::uint64_t>(query.Integer(3));
    tube.doubt = query.Text(4);
    tube.session = query.Text(5);
    tube.used = query.Integer(6) != 0;
    tubes.push_back(std::move(tube));
  }
  if (code != SQLITE_DONE) return hal::Fail(SqlError(db_, "read the tubes"));
  std::reverse(tubes.begin(), tubes.end());
  return tubes;
}

hal::Result<std::vector<std::string>> LedgerStore::Sessions(ScanFate fate) const {
  Statement query(db_,
                  "SELECT session FROM scan WHERE state = ? AND id IN"
                  " (SELECT max(id) FROM scan GROUP BY session) ORDER BY id");
  query.Bind(std::string(Name(fate)));
  std::vector<std::string> sessions;
  int code = SQLITE_ROW;
  while ((code = query.Step()) == SQLITE_ROW) sessions.push_back(query.Text(0));
  if (code != SQLITE_DONE) return hal::Fail(SqlError(db_, "read the scans"));
  return sessions;
}

}  // namespace bendloop::host
