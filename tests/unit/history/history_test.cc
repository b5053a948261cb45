// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/history/history.h"

#include <gmock/gmock.h>
#include <sqlite3.h>
#include <unistd.h>

#include <fstream>

#include "firmware-host/ledger/moment.h"
#include "firmware-host/result/result_json.h"
#include "tests/support/sample_run.h"

namespace bendloop::host {
namespace {

using testing::HasSubstr;

class HistoryFile : public testing::Test {
 protected:
  HistoryFile() {
    folder_ = std::filesystem::temp_directory_path() /
              ("bendloop-history-" + std::to_string(getpid()) + "-" +
               testing::UnitTest::GetInstance()->current_test_info()->name());
    std::filesystem::create_directories(folder_);
  }
  ~HistoryFile() override { std::filesystem::remove_all(folder_); }
  std::filesystem::path path() const { return folder_ / "history.db"; }
  void Sql(const char* sql) const {
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open(path().c_str(), &db), SQLITE_OK);
    ASSERT_EQ(sqlite3_exec(db, sql, nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(db);
    sqlite3_close(db);
  }

  std::filesystem::path folder_;
};

TEST_F(HistoryFile, KeepsPartsOverAReopening) {
  const RunResult run = SampleRun(1);
  {
    auto history = History::Open(path());
    ASSERT_TRUE(history) << history.error().message;
    EXPECT_EQ(*history->Add(run), 1);
    EXPECT_EQ(*history->Add(SampleRun(2, 0.1)), 2);
  }
  auto history = History::Open(path());
  ASSERT_TRUE(history) << history.error().message;
  const auto parts = history->Last(10);
  ASSERT_TRUE(parts) << parts.error().message;
  ASSERT_EQ(parts->size(), 2u);
  EXPECT_EQ((*parts)[0].id, 1);
  EXPECT_EQ(WriteResultJson((*parts)[0].result, {.timing = false}),
            WriteResultJson(run, {.timing = false}));
  EXPECT_EQ((*parts)[1].result.inspection->verdict, pipeline::Verdict::kPass);
}

TEST_F(HistoryFile, DropsTheOldestAndNeverReusesAnId) {
  auto history = History::Open(path(), {.most_parts = 3});
  ASSERT_TRUE(history);
  for (int i = 1; i <= 7; ++i) EXPECT_EQ(*history->Add(SampleRun(i, 0.1, 10)), i);
  EXPECT_EQ(*history->Count(), 3u);
  EXPECT_EQ(history->Last(2)->front().id, 6);
  Sql("DELETE FROM part");
  EXPECT_EQ(*history->Add(SampleRun()), 8);
}

TEST_F(HistoryFile, FindsThePartsOfOneName) {
  auto history = History::Open(":memory:");
  ASSERT_TRUE(history);
  RunResult other = SampleRun();
  other.part = "x'; DROP TABLE part; --";
  ASSERT_TRUE(history->Add(other));
  ASSERT_TRUE(history->Add(SampleRun(2)));
  ASSERT_TRUE(history->Add(RunResult{}));  // a scan without anything is a part as well
  EXPECT_EQ(history->Last(10, other.part)->size(), 1u);
  EXPECT_EQ(history->Last(10, "manifold-return")->front().id, 2);
  EXPECT_EQ(history->Last(10, "none")->size(), 0u);
  EXPECT_EQ(history->Last(0)->size(), 0u);
  EXPECT_EQ(*history->Count(), 3u);
}

TEST_F(HistoryFile, RefusesForeignAndNewerFilesInOneLine) {
  std::ofstream(path()) << "this is a text that is no database at all, whatever its name says.....";
  auto history = History::Open(path());
  ASSERT_FALSE(history);
  EXPECT_EQ(history.error().kind, hal::ErrorKind::kBadInput);
  EXPECT_THAT(history.error().message, HasSubstr("not a database"));

  std::filesystem::remove(path());
  Sql("CREATE TABLE session(x)");
  history = History::Open(path());
  ASSERT_FALSE(history);
  EXPECT_THAT(history.error().message, HasSubstr("not a history of parts"));

  std::filesystem::remove(path());
  ASSERT_TRUE(History::Open(path()));
  Sql("PRAGMA user_version=3");
  history = History::Open(path());
  ASSERT_FALSE(history);
  EXPECT_EQ(history.error().kind, hal::ErrorKind::kBadInput);
  EXPECT_THAT(history.error().message,
              HasSubstr("of version 3, and this bendloop knows versions up "
                        "to 2: a newer one wrote it"));

  EXPECT_FALSE(History::Open(folder_ / "none" / "history.db"));
}

// As the first release wrote it.
constexpr const char* kFirstSchema =
    "CREATE TABLE part(  id INTEGER PRIMARY KEY AUTOINCREMENT,  time TEXT NOT NULL,"
    "  part TEXT NOT NULL,  session TEXT NOT NULL,  verdict TEXT,  correction TEXT,"
    "  sequence INTEGER,  result TEXT NOT NULL);CREATE INDEX part_name ON part(part, id);"
    "PRAGMA application_id=1112295497; PRAGMA user_version=1;"
    "INSERT INTO part(time, part, session, verdict, result) VALUES('2026-01-02T03:04:05.678Z',"
    " 'elbow', 'part-0041', 'pass', '{\"schema\":\"bendloop.result/1\",\"part\":\"elbow\"}')";

TEST_F(HistoryFile, TakesUpWhatTheFirstReleaseWrote) {
  for (const char* later : {"SELECT 1",
                            "CREATE TABLE alarm(id INTEGER PRIMARY KEY AUTOINCREMENT,"
                            "code INTEGER NOT NULL, severity TEXT NOT NULL, text TEXT "
                            "NOT NULL, detail TEXT NOT NULL, began TEXT NOT NULL,"
                            "ended TEXT, UNIQUE(code, began))"}) {
    Sql(kFirstSchema);
    Sql(later);
    auto history = History::Open(path());
    ASSERT_TRUE(history) << history.error().message;
    EXPECT_EQ(*history->Count(), 1u);
    EXPECT_EQ(*history->LargestPartNumber(), 41u);
    EXPECT_EQ(*history->Add(SampleRun(), 3), 2);
    EXPECT_TRUE(history->NoteAlarm({AlarmCode::kBenderAway, "", 1, 0, 0}));
    ASSERT_TRUE(History::Open(path()));  // and again as it is now
    std::filesystem::remove(path());
  }
}

TEST_F(HistoryFile, WhatIsOldGoesAndWhatIsKeptStays) {
  auto history = History::Open(path(), {.most_parts = 4});
  ASSERT_TRUE(history);
  history->Keep({"part-0001"});
  for (int i = 1; i <= 6; ++i) {
    RunResult run = SampleRun(i, 0.1, 10);
    run.session = "part-000" + std::to_string(i);
    run.time = "2026-03-0" + std::to_string(i) + "T00:00:00.000Z";
    ASSERT_TRUE(history->Add(run));
  }
  EXPECT_EQ(*history->Count(), 5u);  // of 4, and the one that is kept
  const std::int64_t now_ms = *ParseUtc("2026-03-07T00:00:00.000Z");
  EXPECT_EQ(*history->DropOld(2.5, now_ms), 2u);
  std::vector<std::string> left;
  const auto parts = history->Last(10);
  for (const HistoryPart& part : *parts) left.push_back(part.result.session);
  EXPECT_THAT(left, testing::ElementsAre("part-0001", "part-0005", "part-0006"));
}

TEST_F(HistoryFile, ADamagedRowIsAnErrorThatNamesIt) {
  auto history = History::Open(path());
  ASSERT_TRUE(history->Add(SampleRun()));
  Sql("UPDATE part SET result = substr(result, 1, 50)");
  const auto parts = history->Last(1);
  ASSERT_FALSE(parts);
  EXPECT_THAT(parts.error().message, HasSubstr("part 1: byte 51: not JSON"));
}

TEST_F(HistoryFile, APartThatWasNotCommittedIsNotThere) {
  auto history = History::Open(path());
  ASSERT_TRUE(history->Add(SampleRun(1)));
  // What a process leaves that dies in the middle of a transaction: its copy has no commit.
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(path().c_str(), &db), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(db, "BEGIN IMMEDIATE; DELETE FROM part", nullptr, nullptr, nullptr),
            SQLITE_OK);
  EXPECT_EQ(*history->Count(), 1u);  // readers go on meanwhile
  sqlite3_close(db);
  EXPECT_EQ(*history->Count(), 1u);
  EXPECT_TRUE(history->Add(SampleRun(2)));
}

}  // namespace
}  // namespace bendloop::host
