// SPDX-License-Identifier: Apache-2.0
#pragma once

// What every hal::BenderLink must do, whatever the carrier. Include it in a test and instantiate:
//   INSTANTIATE_TEST_SUITE_P(Modbus, BenderLinkConformance, testing::Values(...factories...));

#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <limits>
#include <memory>
#include <random>

#include "hal/bender_link.h"
#include "hal/clock.h"
#include "tests/support/bender_maps.h"
#include "tests/support/bender_under_test.h"

namespace bendloop::test {

struct BenderFactory {
  std::string name;
  std::function<std::unique_ptr<BenderUnderTest>()> make;
  friend void PrintTo(const BenderFactory& factory, std::ostream* out) { *out << factory.name; }
};

class BenderLinkConformance : public testing::TestWithParam<BenderFactory> {
 protected:
  void SetUp() override { bender_ = GetParam().make(); }
  hal::BenderLink& link() { return bender_->link(); }

  hal::ProgramBlock Block(std::uint32_t sequence, int bends) {
    return {bender_->Active().part_number, sequence, RandomProgram(random_, bends), 0};
  }

  static testing::AssertionResult Done(const hal::Result<void>& result) {
    if (result) return testing::AssertionSuccess();
    return testing::AssertionFailure() << result.error().message;
  }

  // Polls until the commit of `sequence` is answered; the deadline only ends a failing test.
  hal::BenderState AwaitReply(std::uint32_t sequence) {
    hal::SteadyClock clock;
    const auto deadline = clock.Now() + std::chrono::seconds(20);
    hal::BenderState state;
    while (clock.Now() < deadline) {
      if (auto read = link().ReadState()) state = *read;
      if (state.reply_sequence == sequence && state.reply != hal::CommitReply::kNone) return state;
    }
    ADD_FAILURE() << "no reply to sequence " << sequence;
    return state;
  }

  std::unique_ptr<BenderUnderTest> bender_;
  std::mt19937_64 random_{7};
};

TEST_P(BenderLinkConformance, ConnectTellsWhatTheBenderCan) {
  const auto info = link().Connect();
  ASSERT_TRUE(info) << info.error().message;
  EXPECT_GE(info->max_rows, 10u);
  EXPECT_TRUE(info->atomic_commit);
  EXPECT_TRUE(info->has_heartbeat);
  EXPECT_FALSE(info->description.empty());
  EXPECT_GE(info->max_sequence, 65535u);
}

TEST_P(BenderLinkConformance, EveryCallConnectsByItself) {
  const auto state = link().ReadState();
  ASSERT_TRUE(state) << state.error().message;
  EXPECT_EQ(state->mode, hal::BenderMode::kIdle);
  EXPECT_EQ(state->reply, hal::CommitReply::kNone);
}

TEST_P(BenderLinkConformance, ReadsTheActiveProgramAsTheBenderHoldsIt) {
  const auto active = link().ReadActive();
  ASSERT_TRUE(active) << active.error().message;
  EXPECT_EQ(*active, bender_->Active());
  const auto state = link().ReadState();
  ASSERT_TRUE(state);
  EXPECT_EQ(state->active_part_number, active->part_number);
  EXPECT_EQ(state->active_sequence, active->sequence);
}

TEST_P(BenderLinkConformance, HeartbeatChanges) {
  hal::SteadyClock clock;
  const auto first = link().ReadState();
  ASSERT_TRUE(first);
  const auto deadline = clock.Now() + std::chrono::seconds(20);
  bool changed = false;
  while (!changed && clock.Now() < deadline) {
    const auto now = link().ReadState();
    ASSERT_TRUE(now);
    changed = now->heartbeat != first->heartbeat;
  }
  EXPECT_TRUE(changed);
}

TEST_P(BenderLinkConformance, EncodeIsWhatComesBackAfterStaging) {
  for (int bends : {1, 4, 20}) {
    const hal::ProgramBlock block = Block(static_cast<std::uint32_t>(100 + bends), bends);
    const auto encoded = link().Encode(block);
    ASSERT_TRUE(encoded) << encoded.error().message;
    EXPECT_EQ(encoded->program.rows.size(), block.program.rows.size());
    for (std::size_t i = 0; i < block.program.rows.size(); ++i) {
      EXPECT_NEAR(encoded->program.rows[i].angle_deg, block.program.rows[i].angle_deg, 0.006);
      EXPECT_NEAR(encoded->program.rows[i].length_mm, block.program.rows[i].length_mm, 0.006);
      EXPECT_NEAR(hal::WrapRotationDeg(encoded->program.rows[i].rotation_deg -
                                       block.program.rows[i].rotation_deg),
                  0, 0.011);
    }
    ASSERT_TRUE(Done(link().Stage(block)));
    const auto staged = link().ReadStaged();
    ASSERT_TRUE(staged) << staged.error().message;
    EXPECT_EQ(*staged, *encoded);
    EXPECT_EQ(bender_->Staged(), *encoded);
  }
}

TEST_P(BenderLinkConformance, StagingLeavesTheActiveProgramAlone) {
  const hal::ProgramBlock before = bender_->Active();
  ASSERT_TRUE(Done(link().Stage(Block(9, 5))));
  EXPECT_EQ(bender_->Active(), before);
}

TEST_P(BenderLinkConformance, CommitSwapsAndIsAcknowledged) {
  const auto encoded = link().Encode(Block(12, 6));
  ASSERT_TRUE(encoded);
  ASSERT_TRUE(Done(link().Stage(*encoded)));
  ASSERT_TRUE(Done(link().Commit(12)));
  EXPECT_EQ(AwaitReply(12).reply, hal::CommitReply::kAccepted);
  EXPECT_EQ(bender_->Active(), *encoded);
  const auto active = link().ReadActive();
  ASSERT_TRUE(active) << active.error().message;
  EXPECT_EQ(*active, *encoded);
}

TEST_P(BenderLinkConformance, CommitOfAnotherSequenceIsRejected) {
  const hal::ProgramBlock before = bender_->Active();
  ASSERT_TRUE(Done(link().Stage(Block(12, 6))));
  ASSERT_TRUE(Done(link().Commit(13)));
  EXPECT_EQ(AwaitReply(13).reply, hal::CommitReply::kRejected);
  EXPECT_EQ(bender_->Active(), before);
}

TEST_P(BenderLinkConformance, CommitWhileBendingIsRejected) {
  const hal::ProgramBlock before = bender_->Active();
  ASSERT_TRUE(Done(link().Stage(Block(12, 6))));
  bender_->Misbehave("mode bending");
  const auto state = link().ReadState();
  ASSERT_TRUE(state);
  EXPECT_EQ(state->mode, hal::BenderMode::kBending);
  ASSERT_TRUE(Done(link().Commit(12)));
  EXPECT_EQ(AwaitReply(12).reply, hal::CommitReply::kRejected);
  EXPECT_EQ(bender_->Active(), before);
}

TEST_P(BenderLinkConformance, RefusesWhatDoesNotFitAndSaysWhere) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  for (double bad : {nan, inf, -inf, 1e300}) {
    hal::ProgramBlock block = Block(5, 3);
    block.program.rows[2].angle_deg = bad;
    for (const auto& result : {link().Encode(block).map([](auto&&) {}), link().Stage(block)}) {
      ASSERT_FALSE(result) << bad;
      EXPECT_EQ(result.error().kind, hal::ErrorKind::kBadInput);
      EXPECT_NE(result.error().message.find("row 3 angle_deg"), std::string::npos)
          << result.error().message;
      EXPECT_EQ(result.error().message.find('\n'), std::string::npos);
    }
  }
  const auto info = link().Connect();
  ASSERT_TRUE(info);
  const auto too_long = link().Encode(Block(5, static_cast<int>(info->max_rows)));
  ASSERT_FALSE(too_long);
  EXPECT_EQ(too_long.error().kind, hal::ErrorKind::kBadInput);
  EXPECT_FALSE(link().Encode({1, 1, {}, 0}));
}

TEST_P(BenderLinkConformance, LyingRowCountIsAnErrorNotAnAllocation) {
  bender_->Misbehave("lying-rows");
  const auto active = link().ReadActive();
  ASSERT_FALSE(active);
  EXPECT_EQ(active.error().kind, hal::ErrorKind::kDevice);
  EXPECT_NE(active.error().message.find("rows"), std::string::npos) << active.error().message;
}

// After each of these a call fails as kDevice within its time; then the bender behaves again and
// so does the link, without being told.
TEST_P(BenderLinkConformance, RecoversFromEveryKindOfBadAnswer) {
  for (const char* wrong : {"silent", "mute", "garbage", "short", "wrong-unit", "wrong-transaction",
                            "exception 4", "late 900"}) {
    SCOPED_TRACE(wrong);
    ASSERT_TRUE(link().ReadState());
    bender_->Misbehave(wrong);
    const auto state = link().ReadState();
    ASSERT_FALSE(state);
    EXPECT_EQ(state.error().kind, hal::ErrorKind::kDevice);
    EXPECT_EQ(state.error().message.find('\n'), std::string::npos);
    bender_->Misbehave("behave");
    const auto active = link().ReadActive();
    ASSERT_TRUE(active) << active.error().message;
    EXPECT_EQ(*active, bender_->Active());
  }
}

TEST_P(BenderLinkConformance, RecoversFromAReboot) {
  ASSERT_TRUE(link().ReadState());
  bender_->Misbehave("reboot");
  hal::SteadyClock clock;
  const auto deadline = clock.Now() + std::chrono::seconds(20);
  bool idle = false;
  while (!idle && clock.Now() < deadline) {
    const auto state = link().ReadState();
    idle = state && state->mode == hal::BenderMode::kIdle;
  }
  EXPECT_TRUE(idle);
  const auto staged = link().ReadStaged();
  ASSERT_TRUE(staged);
  EXPECT_TRUE(staged->program.rows.empty());
}

TEST_P(BenderLinkConformance, HalfWrittenStagingIsSeen) {
  const auto encoded = link().Encode(Block(12, 15));
  ASSERT_TRUE(encoded);
  bender_->Misbehave("half-write");
  ASSERT_TRUE(Done(link().Stage(*encoded)));
  const auto staged = link().ReadStaged();
  EXPECT_TRUE(!staged || *staged != *encoded);
  ASSERT_TRUE(Done(link().Commit(12)));
  EXPECT_EQ(AwaitReply(12).reply, hal::CommitReply::kRejected);
}

}  // namespace bendloop::test
