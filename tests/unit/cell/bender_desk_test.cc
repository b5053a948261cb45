// SPDX-License-Identifier: Apache-2.0
// Whose commit's end is told, and how often.
#include "firmware-host/cell/bender_desk.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <list>

#include "tests/support/hand_clock.h"
#include "tests/support/memory_bender.h"

namespace bendloop::host {
namespace {

using ::testing::HasSubstr;

// A line to a bender that can be cut.
class Line final : public hal::BenderLink {
 public:
  explicit Line(test::MemoryBender& bender) : bender_(bender) {}

  hal::Result<hal::BenderInfo> Connect() override {
    return Over<hal::Result<hal::BenderInfo>>([&] { return bender_.Connect(); });
  }
  hal::Result<hal::BenderState> ReadState() override {
    return Over<hal::Result<hal::BenderState>>([&] { return bender_.ReadState(); });
  }
  hal::Result<hal::ProgramBlock> ReadActive() override {
    return Over<hal::Result<hal::ProgramBlock>>([&] { return bender_.ReadActive(); });
  }
  hal::Result<hal::ProgramBlock> ReadStaged() override {
    return Over<hal::Result<hal::ProgramBlock>>([&] { return bender_.ReadStaged(); });
  }
  hal::Result<hal::ProgramBlock> Encode(const hal::ProgramBlock& block) override {
    return bender_.Encode(block);
  }
  hal::Result<void> Stage(const hal::ProgramBlock& block) override {
    return Over<hal::Result<void>>([&] { return bender_.Stage(block); });
  }
  hal::Result<void> Commit(std::uint32_t sequence) override {
    if (commit_arrives) (void)bender_.Commit(sequence);
    if (commit_cuts) fails = 1'000'000;
    if (commit_cuts) return hal::Fail(Cut());
    return {};
  }

  int fails = 0;  // so many exchanges to come
  bool commit_cuts = false;
  bool commit_arrives = true;

 private:
  hal::Error Cut() const { return {hal::ErrorKind::kDevice, "the line is cut"}; }
  bool Goes() { return fails == 0 || --fails < 0; }
  template <class Result>
  Result Over(const std::function<Result()>& exchange) {
    if (Goes()) return exchange();
    return hal::Fail(Cut());
  }

  test::MemoryBender& bender_;
};

class BenderDeskTest : public testing::Test {
 protected:
  BenderDeskTest() : bender_(test::PlainMap(), {42, 3, test::RandomProgram(random_, 4), 0}) {
    auto line = std::make_unique<Line>(bender_);
    line_ = line.get();
    auto desk = BenderDesk::Open(std::move(line),
                                 {.journal = ":memory:", .preload = {}, .commit = {}}, clock_);
    EXPECT_TRUE(desk);
    desk_ = std::move(*desk);
    EXPECT_TRUE(desk_->Look().facts);
  }

  CommitReport Send(const std::string& session) {
    return desk_->Commit({session, bender_.Active(), test::RandomProgram(random_, 4)});
  }
  // The line is cut at the commit's write: nobody knows how it ended.
  void LoseEndOf(const std::string& session, bool arrives) {
    line_->commit_cuts = true;
    line_->commit_arrives = arrives;
    EXPECT_EQ(Send(session).outcome, CommitOutcome::kUnknown);
    line_->commit_cuts = false;
    line_->commit_arrives = true;
  }
  std::vector<SettledCommit> Told() {
    std::list<SettledCommit> told;
    desk_->TakeSettled(told);
    return {told.begin(), told.end()};
  }

  std::mt19937_64 random_{5};
  tests::HandClock clock_;
  test::MemoryBender bender_;
  Line* line_ = nullptr;
  std::unique_ptr<BenderDesk> desk_;
};

TEST_F(BenderDeskTest, TellsAnEndThatTheNextCommitFoundOut) {
  LoseEndOf("scan-1", true);
  // There again only when the next commit itself looks what was left open.
  line_->fails = 1;
  EXPECT_EQ(Send("scan-2").outcome, CommitOutcome::kCommitted);
  ASSERT_TRUE(desk_->Look().facts);
  const auto told = Told();
  ASSERT_EQ(told.size(), 1u);
  EXPECT_EQ(told[0].session, "scan-1");
  EXPECT_EQ(told[0].report.outcome, CommitOutcome::kCommitted);
  ASSERT_TRUE(desk_->Look().facts);
  EXPECT_TRUE(Told().empty()) << "once";
}

TEST_F(BenderDeskTest, TellsEachEndOfTheSameScan) {
  LoseEndOf("scan-1", false);
  line_->fails = 0;
  ASSERT_TRUE(desk_->Look().facts);
  LoseEndOf("scan-1", true);
  line_->fails = 0;
  ASSERT_TRUE(desk_->Look().facts);
  const auto told = Told();
  ASSERT_EQ(told.size(), 2u);
  EXPECT_EQ(told[0].report.outcome, CommitOutcome::kFailed);
  EXPECT_EQ(told[1].report.outcome, CommitOutcome::kCommitted);
}

TEST_F(BenderDeskTest, AnEndThatIsTakenFromTheJournalIsWhatItWas) {
  LoseEndOf("scan-1", false);
  line_->fails = 1;
  EXPECT_EQ(Send("scan-2").outcome, CommitOutcome::kCommitted);
  ASSERT_TRUE(desk_->Look().facts);
  const auto told = Told();
  ASSERT_EQ(told.size(), 1u);
  EXPECT_EQ(told[0].session, "scan-1");
  EXPECT_EQ(told[0].report.outcome, CommitOutcome::kFailed) << "nobody refused it";
  EXPECT_THAT(told[0].report.reason, HasSubstr("the old program is active"));
}

}  // namespace
}  // namespace bendloop::host
