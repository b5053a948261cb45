// SPDX-License-Identifier: Apache-2.0
// What becomes of journal.db over the years: of older versions, damaged, and long.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "drivers/sqlite/damaged_file.h"
#include "firmware-host/commit/commit_journal.h"
#include "firmware-host/ledger/damaged_journal.h"
#include "firmware-host/ledger/journal_retention.h"
#include "firmware-host/ledger/ledger_store.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

constexpr std::int64_t kDayMs = 86'400'000;

// As the first release wrote it.
constexpr const char* kFirstSchema =
    "PRAGMA application_id = 1112294218;"
    "CREATE TABLE IF NOT EXISTS attempt(id INTEGER PRIMARY KEY, session TEXT NOT NULL,"
    " base TEXT NOT NULL, next TEXT NOT NULL);"
    "CREATE TABLE IF NOT EXISTS step(id INTEGER PRIMARY KEY, attempt INTEGER NOT NULL,"
    " unix_ms INTEGER NOT NULL, step TEXT NOT NULL, detail TEXT NOT NULL);"
    "CREATE TABLE IF NOT EXISTS sequence(id INTEGER PRIMARY KEY, number INTEGER NOT NULL);"
    "CREATE INDEX IF NOT EXISTS attempt_session ON attempt(session);"
    "CREATE INDEX IF NOT EXISTS step_attempt ON step(attempt);"
    "PRAGMA user_version = 1;"
    "INSERT INTO sequence(number) VALUES(17)";

class JournalYears : public ::testing::Test {
 protected:
  JournalYears() {
    std::string name = (fs::temp_directory_path() / "bendloop-XXXXXX").string();
    folder_ = mkdtemp(name.data());
  }
  ~JournalYears() override { fs::remove_all(folder_); }

  fs::path file() const { return folder_ / "journal.db"; }
  drivers::Database Opened() const {
    auto database = drivers::Database::Open(file().string(), file().string());
    EXPECT_TRUE(database) << database.error().message;
    return std::move(*database);
  }
  void Sql(const std::string& sql) const {
    const auto done = Opened().Execute(sql);
    EXPECT_TRUE(done) << done.error().message;
  }
  std::int64_t Number(const char* sql) const { return Opened().Integer(sql).value_or(-1); }
  // An attempt of `session` that came to its end, or not, so many days ago.
  void Attempt(const std::string& session, double days_ago, const char* last = "committed") const {
    const auto at = std::to_string(kNowMs - static_cast<std::int64_t>(days_ago * kDayMs));
    Sql("INSERT INTO attempt(session, base, next) VALUES('" + session + "', '{}', '{}');" +
        "INSERT INTO step(attempt, unix_ms, step, detail) SELECT max(id), " + at + ", '" + last +
        "', '' FROM attempt");
  }

  static constexpr std::int64_t kNowMs = 1'795'359'180'000;
  fs::path folder_;
};

TEST_F(JournalYears, TakesUpWhatTheFirstReleaseWroteAndRefusesWhatANewerOneDid) {
  Sql(kFirstSchema);
  auto journal = CommitJournal::Open(file());
  ASSERT_TRUE(journal) << journal.error().message;
  EXPECT_EQ(journal->LastSequence().value(), 17u);
  EXPECT_TRUE(journal->NoteVoid(18));
  EXPECT_TRUE(LedgerStore::Open(file()));
  EXPECT_EQ(Number("PRAGMA user_version"), 5);
  EXPECT_FALSE(SetDamagedJournalAside(file(), kNowMs).value());

  Sql("PRAGMA user_version = 6");
  journal = CommitJournal::Open(file());
  ASSERT_FALSE(journal);
  EXPECT_EQ(journal.error().kind, hal::ErrorKind::kBadInput);
  EXPECT_THAT(journal.error().message, HasSubstr("a newer one wrote it"));
  // It is not damaged, and nobody moves it.
  EXPECT_FALSE(SetDamagedJournalAside(file(), kNowMs).value());
  EXPECT_EQ(Number("PRAGMA user_version"), 6);
}

TEST_F(JournalYears, ADamagedOneIsMovedAsideAndLocks) {
  std::ofstream(file())
      << "the disk wrote this over the first page of the journal, and more ......";
  const auto aside = SetDamagedJournalAside(file(), kNowMs);
  ASSERT_TRUE(aside && *aside);
  EXPECT_EQ((*aside)->filename(), "journal.db.damaged-20261122T145300Z");
  // The power may go before the new one is locked: the next start does it.
  for (int start = 0; start < 2; ++start) {
    EXPECT_FALSE(SetDamagedJournalAside(file(), kNowMs).value());
    ASSERT_TRUE(LockForDamagedJournals(file()));
    const auto breach = CommitJournal::Open(file())->OpenBreach().value();
    ASSERT_TRUE(breach);
    EXPECT_TRUE(IsOfJournal(*breach));
    EXPECT_THAT(*breach, HasSubstr("journal.db.damaged-20261122T145300Z"));
  }
  // It locks once, though the file stays where it is.
  ASSERT_TRUE(CommitJournal::Open(file())->Acknowledge("setter"));
  ASSERT_TRUE(LockForDamagedJournals(file()));
  EXPECT_FALSE(CommitJournal::Open(file())->OpenBreach().value());
}

TEST_F(JournalYears, ARowWithoutSenseIsDamageToo) {
  ASSERT_TRUE(CommitJournal::Open(file()));
  Attempt("part-0001", 1, "committing");
  EXPECT_TRUE(SetDamagedJournalAside(file(), kNowMs).value());  // its programs are none
  EXPECT_EQ(drivers::MovedAside(file()).size(), 1u);
  ASSERT_TRUE(CommitJournal::Open(file()));
  Sql("INSERT INTO program(block) VALUES('x');"
      "INSERT INTO change(unix_ms, parts_bent, program, epoch, what) VALUES(1, 1, 1, 1, '')");
  EXPECT_TRUE(SetDamagedJournalAside(file(), kNowMs).value());
  EXPECT_EQ(drivers::MovedAside(file()).size(), 2u);
}

TEST_F(JournalYears, LongAgoIsDroppedAndTheNewestAndWhatWaitsStay) {
  ASSERT_TRUE(CommitJournal::Open(file()));
  // A part an hour, for four months.
  const auto hours_ago = [](const char* count) {
    return "(" + std::to_string(kNowMs) + " - (3000 - " + count + ") * 3600000)";
  };
  Sql("BEGIN;"
      "WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n LIMIT 3000)"
      " INSERT INTO attempt SELECT k, printf('part-%04d', k), '{}', '{}' FROM n;"
      "INSERT INTO step(attempt, unix_ms, step, detail) SELECT id, " +
      hours_ago("id") +
      ", 'committed', '' FROM attempt;"
      "INSERT INTO scan(unix_ms, session, tube, state, detail) SELECT " +
      hours_ago("id") +
      ", session, id, iif(id = 7, 'waiting', 'corrected'), '' FROM attempt;"
      "INSERT INTO tube(id, unix_ms, count, program, epoch, doubt) SELECT id, " +
      hours_ago("id") +
      ", id, id, 1, '' FROM attempt;"
      "INSERT INTO name SELECT id, " +
      hours_ago("id") +
      ", session, 77, session FROM attempt;"
      "INSERT INTO program SELECT id, 'block ' || id FROM attempt;"
      "INSERT INTO sequence(number) SELECT id FROM attempt; COMMIT");
  for (int call = 0; call < 3; ++call) ASSERT_TRUE(DropOldFromJournal(file(), 100.01, kNowMs));
  // 600 hours and some are too old; one of these waits.
  EXPECT_EQ(Number("SELECT count(*) FROM attempt"), 2402);
  EXPECT_EQ(Number("SELECT count(*) FROM step"), 2402);
  EXPECT_EQ(Number("SELECT count(*) FROM scan"), 2402);
  EXPECT_EQ(Number("SELECT min(id) FROM scan"), 7);
  EXPECT_EQ(Number("SELECT count(*) FROM tube"), 2402);
  EXPECT_EQ(Number("SELECT count(*) FROM program"), 2402);
  EXPECT_EQ(Number("SELECT count(*) FROM name"), 2401);
  EXPECT_EQ(Number("SELECT count(*) FROM sequence"), 3000);
  // However short the limit is, the newest stay.
  for (int call = 0; call < 3; ++call) ASSERT_TRUE(DropOldFromJournal(file(), 0.01, kNowMs));
  EXPECT_EQ(Number("SELECT count(*) FROM attempt"), 1001);
  EXPECT_EQ(CommitJournal::Open(file())->LargestPartNumber().value(), 3000u);
  EXPECT_EQ(CommitJournal::Open(file())->LastSequence().value(), 3000u);
}

}  // namespace
}  // namespace bendloop::host
