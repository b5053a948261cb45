// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/ledger/journal_retention.h"

#include <algorithm>
#include <string>

#include "firmware-host/commit/journal_file.h"
#include "firmware-host/retention/age.h"

namespace bendloop::host {
namespace {

using Outcome = drivers::Statement::Outcome;

constexpr std::int64_t kNewestRows = 1000;
// More numbers than a bender's register of 16 bits has.
constexpr std::int64_t kNewestSequences = 100'000;
// Of each table in one call: some 20 ms of the thread that waits.
constexpr std::int64_t kMostRows = 2000;

constexpr const char* kInHand =
    "(SELECT session FROM scan WHERE state IN ('waiting', 'unknown') AND id IN"
    " (SELECT max(id) FROM scan GROUP BY session))";

// Rows of `table` up to this id are to go.
hal::Result<std::int64_t> LastOld(const drivers::Database& database, const std::string& table,
                                  double most_days, std::int64_t now_ms) {
  auto rows = database.Prepare(("SELECT id, unix_ms FROM " + table + " ORDER BY id DESC").c_str());
  if (!rows) return hal::Fail(rows.error());
  Age age(now_ms);
  Outcome outcome = Outcome::kRow;
  std::int64_t last = 0;
  for (std::int64_t newer = 0; (outcome = rows->Step()) == Outcome::kRow; ++newer) {
    if (age.DaysOf(rows->Integer(1)) <= most_days || newer < kNewestRows) continue;
    last = rows->Integer(0);
    break;
  }
  if (outcome == Outcome::kFailed) return hal::Fail(database.Failed("cannot be read"));
  rows->Reset();
  const auto first = database.Integer(("SELECT ifnull(min(id), 0) FROM " + table).c_str());
  if (!first) return first;
  return std::min(last, *first + kMostRows);
}

}  // namespace

hal::Result<void> DropOldFromJournal(const std::filesystem::path& journal, double most_days,
                                     std::int64_t now_ms) {
  const auto database = OpenJournalFile(journal);
  if (!database) return hal::Fail(database.error());
  return database->Transact("old entries cannot be dropped", [&]() -> hal::Result<void> {
    const auto drop = [&](const char* table, const std::string& sql) -> hal::Result<void> {
      const auto last = LastOld(*database, table, most_days, now_ms);
      if (!last) return hal::Fail(last.error());
      return *last > 0 ? Write(*database, sql.c_str(), *last) : hal::Result<void>();
    };
    const std::string with_tube = "(SELECT tube FROM scan WHERE tube IS NOT NULL)";
    auto done = drop("step",
                     "DELETE FROM attempt WHERE id <="
                     " (SELECT max(attempt) FROM step WHERE id <= ?) AND session NOT IN " +
                         std::string(kInHand));
    if (done) {
      done = database->Execute("DELETE FROM step WHERE attempt NOT IN (SELECT id FROM attempt)");
    }
    if (done) {
      done =
          drop("scan", "DELETE FROM scan WHERE id <= ? AND session NOT IN " + std::string(kInHand));
    }
    if (done) done = drop("name", "DELETE FROM name WHERE id <= ?");
    if (done) done = drop("tube", "DELETE FROM tube WHERE id <= ? AND id NOT IN " + with_tube);
    if (done) done = drop("change", "DELETE FROM change WHERE id <= ?");
    if (!done) return done;
    return database->Execute(
        "DELETE FROM program WHERE id NOT IN (SELECT program FROM change) AND id NOT IN"
        " (SELECT program FROM tube WHERE program IS NOT NULL);"
        "DELETE FROM sequence WHERE id <= (SELECT max(id) FROM sequence) - " +
        std::to_string(kNewestSequences) +
        ";"
        "DELETE FROM void WHERE sequence NOT IN (SELECT id FROM sequence)");
  });
}

}  // namespace bendloop::host
