// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/commit/commit_protocol.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/memory_bender.h"

namespace bendloop::host {
namespace {

using testing::HasSubstr;

class CommitProtocolTest : public testing::Test {
 protected:
  CommitProtocolTest()
      : bender_(test::PlainMap(), {42, 3, test::RandomProgram(random_, 4), 0}),
        journal_(CommitJournal::Open(":memory:").value()),
        protocol_(bender_, journal_, clock_) {}

  CommitRequest Request(const std::string& session = "scan-1") {
    return {session, bender_.Active(), test::RandomProgram(random_, 4)};
  }
  void ExpectUntouched(const CommitReport& report, const hal::ProgramBlock& before) {
    EXPECT_EQ(bender_.Active(), before);
    EXPECT_TRUE(bender_.commits().empty());
    EXPECT_FALSE(report.reason.empty());
    EXPECT_EQ(report.reason.find('\n'), std::string::npos);
    EXPECT_FALSE(journal_.Unfinished().value());
  }

  std::mt19937_64 random_{5};
  hal::ManualClock clock_;
  test::MemoryBender bender_;
  CommitJournal journal_;
  CommitProtocol protocol_;
};

TEST_F(CommitProtocolTest, CommitsAndTellsWhatIsActive) {
  const CommitRequest request = Request();
  const CommitReport report = protocol_.Commit(request);
  ASSERT_EQ(report.outcome, CommitOutcome::kCommitted) << report.reason;
  EXPECT_EQ(report.sequence, 4u);
  EXPECT_EQ(report.active, bender_.Active());
  EXPECT_EQ(bender_.Active().sequence, 4u);
  EXPECT_EQ(bender_.Active().part_number, 42u);
  const auto& rows = bender_.Active().program.rows;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    EXPECT_NEAR(rows[i].angle_deg, request.program.rows[i].angle_deg, 0.00051);
  }
  EXPECT_TRUE(journal_.SessionCommitted("scan-1").value());
  EXPECT_FALSE(protocol_.Resume());
}

TEST_F(CommitProtocolTest, StaleSessionIsRefused) {
  ASSERT_EQ(protocol_.Commit(Request()).outcome, CommitOutcome::kCommitted);
  bender_.commits().clear();
  const auto before = bender_.Active();
  const CommitReport report = protocol_.Commit(Request());
  EXPECT_EQ(report.outcome, CommitOutcome::kRefused);
  EXPECT_THAT(report.reason, HasSubstr("scan-1"));
  ExpectUntouched(report, before);
}

TEST_F(CommitProtocolTest, OtherProgramIsRefused) {
  const CommitRequest request = Request();
  hal::ProgramBlock other = bender_.Active();
  other.program.rows[1].angle_deg += 0.5;
  bender_.LoadActive(other);
  const auto before = bender_.Active();
  const CommitReport report = protocol_.Commit(request);
  EXPECT_EQ(report.outcome, CommitOutcome::kRefused);
  EXPECT_THAT(report.reason, HasSubstr("other program active"));
  EXPECT_THAT(report.reason, HasSubstr("row 2 angle_deg"));
  ExpectUntouched(report, before);
}

TEST_F(CommitProtocolTest, BenderThatIsNotReadyIsRefused) {
  const auto before = bender_.Active();
  const std::pair<hal::BenderMode, const char*> modes[] = {
      {hal::BenderMode::kBending, "is bending"},
      {hal::BenderMode::kNotReady, "not ready"},
      {hal::BenderMode::kFault, "fault"}};
  for (const auto& [mode, word] : modes) {
    bender_.SetMode(mode);
    const CommitReport report = protocol_.Commit(Request());
    EXPECT_EQ(report.outcome, CommitOutcome::kRefused);
    EXPECT_THAT(report.reason, HasSubstr(word));
    ExpectUntouched(report, before);
  }
}

TEST_F(CommitProtocolTest, DeadHeartbeatIsRefused) {
  bender_.frozen = true;
  const auto before = bender_.Active();
  const CommitReport report = protocol_.Commit(Request());
  EXPECT_EQ(report.outcome, CommitOutcome::kRefused);
  EXPECT_THAT(report.reason, HasSubstr("heartbeat"));
  ExpectUntouched(report, before);
}

TEST_F(CommitProtocolTest, ObservedHeartbeatSavesTheWaitWhileItIsFresh) {
  protocol_.Observe(bender_.ReadState().value());
  protocol_.Observe(bender_.ReadState().value());
  bender_.frozen = true;
  ASSERT_EQ(protocol_.Commit(Request()).outcome, CommitOutcome::kCommitted);
  clock_.Advance(std::chrono::seconds(3));
  EXPECT_EQ(protocol_.Commit(Request("scan-2")).outcome, CommitOutcome::kRefused);
}

TEST_F(CommitProtocolTest, ProgramThatDoesNotFitIsRefused) {
  CommitRequest request = Request();
  request.program.rows[2].angle_deg = 1e9;
  const auto before = bender_.Active();
  const CommitReport report = protocol_.Commit(request);
  EXPECT_EQ(report.outcome, CommitOutcome::kRefused);
  EXPECT_THAT(report.reason, HasSubstr("row 3 angle_deg"));
  ExpectUntouched(report, before);
}

TEST_F(CommitProtocolTest, BenderMayReject) {
  bender_.reject_code = 7;
  const auto before = bender_.Active();
  const CommitReport report = protocol_.Commit(Request());
  EXPECT_EQ(report.outcome, CommitOutcome::kRefused);
  EXPECT_THAT(report.reason, HasSubstr("code 7"));
  EXPECT_EQ(bender_.Active(), before);
  // The same session may try again: its measurement is still of the active program.
  bender_.reject_code = 0;
  EXPECT_EQ(protocol_.Commit(Request()).outcome, CommitOutcome::kCommitted);
}

// A PLC that clips an angle to its own limit, and would accept its own version.
TEST_F(CommitProtocolTest, StagedProgramThatReadsBackDifferentlyIsNotCommitted) {
  const auto before = bender_.Active();
  bender_.after_stage = [this] {
    hal::ProgramBlock staged = bender_.memory().Staged().value();
    staged.program.rows[1].angle_deg -= 0.001;
    ASSERT_TRUE(drivers::EncodeProgram(bender_.memory().map(), bender_.memory().map().staging,
                                       staged, bender_.memory().image()));
  };
  const CommitReport report = protocol_.Commit(Request());
  EXPECT_EQ(report.outcome, CommitOutcome::kFailed);
  EXPECT_THAT(report.reason, HasSubstr("row 2 angle_deg"));
  ExpectUntouched(report, before);
}

TEST_F(CommitProtocolTest, PlcWithoutCommitRegisterNeedsPermission) {
  test::MemoryBender bender(test::NoCommitMap(), {42, 3, test::RandomProgram(random_, 4), 0});
  CommitRequest request{"s", bender.Active(), test::RandomProgram(random_, 4)};
  CommitProtocol careful(bender, journal_, clock_);
  const CommitReport refused = careful.Commit(request);
  EXPECT_EQ(refused.outcome, CommitOutcome::kRefused);
  EXPECT_EQ(bender.Active(), request.base);
  CommitOptions options;
  options.allow_non_atomic = true;
  CommitProtocol allowed(bender, journal_, clock_, options);
  const CommitReport report = allowed.Commit(request);
  EXPECT_EQ(report.outcome, CommitOutcome::kCommitted) << report.reason;
  EXPECT_EQ(bender.Active().program.rows.size(), 5u);
}

TEST(NextSequenceNumber, IsNewAndWrapsPastZero) {
  EXPECT_EQ(NextSequenceNumber({0, 0, 0, 0}, 65535), 1u);
  EXPECT_EQ(NextSequenceNumber({3, 9, 5, 0}, 65535), 10u);
  EXPECT_EQ(NextSequenceNumber({65535, 2, 1, 0}, 65535), 3u);
  EXPECT_EQ(NextSequenceNumber({0xFFFFFFFFu, 0, 0, 0}, 0xFFFFFFFFu), 1u);
  EXPECT_EQ(NextSequenceNumber({70000, 1, 0, 0}, 65535), 2u);
}

TEST(SequenceNumbers, SurviveTheWrapOfA16BitRegister) {
  std::mt19937_64 random(1);
  test::MemoryBender bender(test::OddMap(), {1, 65533, test::RandomProgram(random, 3), 0});
  CommitJournal journal = CommitJournal::Open(":memory:").value();
  hal::ManualClock clock;
  CommitProtocol protocol(bender, journal, clock);
  std::vector<std::uint32_t> sequences;
  for (int i = 0; i < 6; ++i) {
    const CommitReport report =
        protocol.Commit({"s" + std::to_string(i), bender.Active(), test::RandomProgram(random, 3)});
    ASSERT_EQ(report.outcome, CommitOutcome::kCommitted) << report.reason;
    sequences.push_back(report.sequence);
  }
  EXPECT_THAT(sequences, testing::ElementsAre(65534, 65535, 1, 2, 3, 4));
}

}  // namespace
}  // namespace bendloop::host
