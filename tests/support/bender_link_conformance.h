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
  // With a link that waits as long for an answer.
  std::function<std::unique_ptr<BenderUnderTest>(std::chrono::milliseconds response_timeout)> make;
  friend void PrintTo(const BenderFactory& factory, std::ostream* out) { *out << factory.name; }
};

class BenderLinkConformance : public testing::TestWithParam<BenderFactory> {
 protected:
  void SetUp() override { bender_ = GetParam().make(kPatient); }
  hal::BenderLink& link() { return bender_->link(); }
  void MakeImpatient() {
    bender_.reset();
    bender_ = GetParam().make(kImpatient);
  }

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
  MakeImpatient();
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

// What of `report` the map can carry.
inline hal::CellReport CarriedBy(const hal::RegisterMap& map, const hal::CellReport& report) {
  const hal::ReportFields& fields = map.report;
  hal::CellReport carried;
  if (fields.heartbeat) carried.heartbeat = report.heartbeat;
  if (fields.state) carried.state = report.state;
  if (fields.alarm) carried.alarm = report.alarm;
  if (fields.alarms) carried.alarms = report.alarms;
  if (fields.sequence) carried.sequence = report.sequence;
  if (fields.verdict) carried.verdict = report.verdict;
  if (fields.part_number) carried.part_number = report.part_number;
  if (fields.identity) carried.identity = report.identity;
  if (fields.worst_percent) carried.worst_percent = report.worst_percent;
  if (fields.tubes) carried.tubes = report.tubes;
  if (fields.passed) carried.passed = report.passed;
  if (fields.failed) carried.failed = report.failed;
  if (fields.undecided) carried.undecided = report.undecided;
  if (fields.held) carried.held = report.held;
  if (fields.part_set) carried.part_set = report.part_set;
  if (fields.acknowledged) carried.acknowledged = report.acknowledged;
  if (fields.lot_begun) carried.lot_begun = report.lot_begun;
  return carried;
}

inline hal::CellReport SampleReport() {
  return {.heartbeat = 7,
          .state = hal::CellState::kHeld,
          .alarm = 4001,
          .alarms = 2,
          .sequence = 70'000,
          .verdict = hal::TubeVerdict::kUndecided,
          .part_number = 1002,
          .identity = "COIL 7/TUBE-0012",
          .worst_percent = 85,
          .tubes = 9,
          .passed = 4,
          .failed = 2,
          .undecided = 1,
          .held = 2,
          .part_set = 1003,
          .acknowledged = 5,
          .lot_begun = 6};
}

TEST_P(BenderLinkConformance, ThePlcReadsWhatItIsTold) {
  const auto info = link().Connect();
  ASSERT_TRUE(info);
  hal::CellReport report = SampleReport();
  EXPECT_EQ(info->takes_report, CarriedBy(bender_->map(), report) != hal::CellReport{});
  ASSERT_TRUE(Done(link().Report(report)));
  EXPECT_EQ(bender_->Heard(), CarriedBy(bender_->map(), report));
  ++report.sequence;
  report.identity = "X";
  report.worst_percent = 4'000'000;  // as much as the register holds
  report.alarm = 0;
  ASSERT_TRUE(Done(link().Report(report)));
  EXPECT_EQ(bender_->Heard().identity, CarriedBy(bender_->map(), report).identity);
  EXPECT_EQ(bender_->Heard().sequence, CarriedBy(bender_->map(), report).sequence);
  EXPECT_EQ(bender_->Heard().alarm, 0u);
  // Nothing of it is in the program's way.
  const auto active = link().ReadActive();
  ASSERT_TRUE(active) << active.error().message;
  EXPECT_EQ(*active, bender_->Active());
}

TEST_P(BenderLinkConformance, WhatThePlcHasForgottenIsWrittenAnew) {
  MakeImpatient();
  if (!link().Connect()->takes_report) return;
  ASSERT_TRUE(Done(link().Report(SampleReport())));
  bender_->Misbehave("silent");
  EXPECT_FALSE(link().ReadState());
  bender_->Misbehave("behave");
  bender_->Misbehave("reboot");
  hal::SteadyClock clock;
  const auto deadline = clock.Now() + std::chrono::seconds(20);
  bool told = false;
  while (!told && clock.Now() < deadline) told = link().Report(SampleReport()).has_value();
  EXPECT_EQ(bender_->Heard(), CarriedBy(bender_->map(), SampleReport()));
}

TEST_P(BenderLinkConformance, WhatThePlcSaysComesWithTheState) {
  const hal::OrderFields& fields = bender_->map().orders;
  hal::PlcOrders said;
  if (fields.part_number) said.part_number = 1002;
  if (fields.scan) said.scan = hal::ScanOrder::kMayRun;
  if (fields.hold) said.hold = true;
  if (fields.new_lot) said.new_lot = 3;
  if (fields.acknowledge) said.acknowledge = 4;
  if (fields.identity) said.identity = "COIL 7/TUBE-0012";
  bender_->Say(said);
  const auto state = link().ReadState();
  ASSERT_TRUE(state) << state.error().message;
  EXPECT_EQ(state->orders, said);
  if (!fields.identity) return;
  said.identity = "no\ttext";
  bender_->Say(said);
  const auto spoilt = link().ReadState();
  ASSERT_TRUE(spoilt) << spoilt.error().message;
  EXPECT_FALSE(spoilt->orders.identity_is_text);
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
