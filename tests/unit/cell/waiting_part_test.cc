// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/waiting_part.h"

#include <gtest/gtest.h>

#include <thread>

#include "bent_tube.h"

namespace bendloop::host {
namespace {

using namespace std::chrono_literals;

class WaitingPartTest : public testing::Test {
 protected:
  // The bender is busy when the part is decided.
  void SetUp() override {
    cell_.bender->SetMode(hal::BenderMode::kBending);
    const PartOutcome outcome = DecidePart(*cell_.plan, cell_.part, *cell_.desk);
    ASSERT_EQ(outcome.end, PartEnd::kWaiting);
    waiting_.Take(cell_.part, outcome, cell_.plan);
    cell_.bender->SetMode(hal::BenderMode::kIdle);
    cell_.clock.Advance(1s);
    cell_.Look();
  }
  // Until nothing waits any more; what there was to tell.
  std::vector<PartOutcome> TendToEnd() {
    std::vector<PartOutcome> told;
    while (waiting_) {
      if (auto news = waiting_.Tend(true)) told.push_back(std::move(*news));
      if (waiting_.is_tried()) std::this_thread::sleep_for(1ms);
      if (!waiting_.is_tried()) cell_.clock.Advance(100ms);
    }
    return told;
  }
  // What an attempt sent whose outcome there was no memory to tell.
  void SendUntold() {
    hal::BendProgram program = cell_.before.program;
    program.rows.front().length_mm += 1;
    EXPECT_EQ(cell_.desk->Commit({cell_.part.identity.session, cell_.before, program}).outcome,
              CommitOutcome::kCommitted);
  }
  int Commits() const {
    int commits = 0;
    for (const auto& [sequence, times] : cell_.bender->commits()) commits += times;
    return commits;
  }

  test::BentTube cell_;
  LifeSigns life_{cell_.clock};
  WaitingPart waiting_{*cell_.desk, cell_.clock, life_};
};

TEST_F(WaitingPartTest, IsSentAndToldWhenTheBenderIsIdle) {
  const auto told = TendToEnd();
  ASSERT_EQ(told.size(), 1u);
  EXPECT_EQ(told[0].end, PartEnd::kCorrected);
  EXPECT_EQ(Commits(), 1);
}

// Decided again it would be told to be refused: its session has led to a commit.
TEST_F(WaitingPartTest, IsLeftToTheDeskWhereItsCorrectionIsOnItsWay) {
  SendUntold();
  EXPECT_TRUE(TendToEnd().empty());
  EXPECT_EQ(Commits(), 1);
}

TEST_F(WaitingPartTest, IsNotGivenUpEitherWhereItsCorrectionIsOnItsWay) {
  SendUntold();
  EXPECT_FALSE(waiting_.GiveUp("the next part was measured first"));
  EXPECT_FALSE(waiting_);
}

TEST_F(WaitingPartTest, IsGivenUpOnce) {
  const auto told = waiting_.GiveUp("the next part was measured first");
  ASSERT_TRUE(told);
  EXPECT_EQ(told->end, PartEnd::kRefused);
  EXPECT_FALSE(waiting_.GiveUp("again"));
  EXPECT_EQ(Commits(), 0);
}

}  // namespace
}  // namespace bendloop::host
