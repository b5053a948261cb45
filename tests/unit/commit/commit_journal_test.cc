// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/commit/commit_journal.h"

#include <gtest/gtest.h>
#include <sqlite3.h>

#include <filesystem>
#include <fstream>
#include <limits>

#include "firmware-host/commit/journal_json.h"
#include "tests/support/bender_maps.h"

namespace bendloop::host {
namespace {

class CommitJournalTest : public testing::Test {
 protected:
  CommitJournalTest() {
    const auto* test = testing::UnitTest::GetInstance()->current_test_info();
    folder_ = std::filesystem::path(testing::TempDir()) /
              (std::string("bendloop-journal-") + test->name() + std::to_string(getpid()));
    std::filesystem::create_directories(folder_);
  }
  ~CommitJournalTest() override { std::filesystem::remove_all(folder_); }

  std::filesystem::path file() const { return folder_ / "commit.sqlite"; }
  CommitJournal Open() {
    auto journal = CommitJournal::Open(file());
    EXPECT_TRUE(journal) << journal.error().message;
    return std::move(*journal);
  }
  CommitAttempt Attempt(std::uint32_t sequence, const std::string& session) {
    CommitAttempt attempt;
    attempt.session = session;
    attempt.base = {7, sequence - 1, test::RandomProgram(random_, 4), 0xDEADBEEF};
    attempt.next = {7, sequence, test::RandomProgram(random_, 4), 0x12345678};
    return attempt;
  }

  std::filesystem::path folder_;
  std::mt19937_64 random_{1};
};

TEST_F(CommitJournalTest, ProgramsComeBackBitForBit) {
  for (int i = 0; i < 200; ++i) {
    const hal::ProgramBlock block{std::numeric_limits<std::uint32_t>::max(), 3,
                                  test::RandomProgram(random_, 5), 0xFFFFFFFF};
    const auto back = ProgramFromJson(ProgramToJson(block));
    ASSERT_TRUE(back);
    EXPECT_EQ(*back, block);
  }
  for (const char* bad : {"", "{", "[]", "{}", "{\"part_number\":1,\"sequence\":2,\"crc\":\"x\"}",
                          "{\"part_number\":1,\"sequence\":2,\"crc\":3,\"rows_lrar\":[[1]]}"}) {
    EXPECT_FALSE(ProgramFromJson(bad)) << bad;
  }
}

TEST_F(CommitJournalTest, RemembersAcrossOpening) {
  const CommitAttempt attempt = Attempt(5, "scan-1");
  {
    CommitJournal journal = Open();
    EXPECT_EQ(journal.LastSequence().value(), 0u);
    EXPECT_FALSE(journal.Unfinished().value());
    const auto id = journal.Begin(attempt);
    ASSERT_TRUE(id);
    ASSERT_TRUE(journal.Append(*id, CommitStep::kCommitting, "x"));
  }
  CommitJournal journal = Open();
  const auto unfinished = journal.Unfinished().value();
  ASSERT_TRUE(unfinished);
  EXPECT_EQ(unfinished->step, CommitStep::kCommitting);
  EXPECT_EQ(unfinished->session, "scan-1");
  EXPECT_EQ(unfinished->base, attempt.base);
  EXPECT_EQ(unfinished->next, attempt.next);
  EXPECT_EQ(journal.LastSequence().value(), 5u);
  EXPECT_FALSE(journal.SessionCommitted("scan-1").value());
  ASSERT_TRUE(journal.Append(unfinished->id, CommitStep::kCommitted, ""));
  EXPECT_FALSE(journal.Unfinished().value());
  EXPECT_TRUE(journal.SessionCommitted("scan-1").value());
  EXPECT_FALSE(journal.SessionCommitted("scan-2").value());
  ASSERT_TRUE(journal.NoteSequence(9));
  EXPECT_EQ(journal.LastSequence().value(), 9u);
}

TEST_F(CommitJournalTest, RefusedAttemptsDoNotMakeASessionStale) {
  CommitJournal journal = Open();
  const auto id = journal.Begin(Attempt(5, "scan-1"));
  ASSERT_TRUE(id);
  ASSERT_TRUE(journal.Append(*id, CommitStep::kNotCommitted, "the guard was open"));
  EXPECT_FALSE(journal.SessionCommitted("scan-1").value());
  EXPECT_FALSE(journal.Unfinished().value());
  EXPECT_EQ(journal.Last().value()->detail, "the guard was open");
}

TEST_F(CommitJournalTest, OtherFilesAreRefused) {
  std::ofstream(file()) << "this is not a database, it is a shopping list: milk, bread, tubes ...";
  const auto text = CommitJournal::Open(file());
  ASSERT_FALSE(text);
  EXPECT_EQ(text.error().kind, hal::ErrorKind::kBadInput);

  const auto other = folder_ / "other.sqlite";
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(other.c_str(), &db), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(db, "CREATE TABLE recipes(id)", nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(db);
  const auto database = CommitJournal::Open(other);
  ASSERT_FALSE(database);
  EXPECT_EQ(database.error().kind, hal::ErrorKind::kBadInput);

  EXPECT_FALSE(CommitJournal::Open(folder_ / "no" / "such" / "folder.sqlite"));
}

}  // namespace
}  // namespace bendloop::host
