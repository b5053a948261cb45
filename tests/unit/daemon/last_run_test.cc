// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/last_run.h"

#include <gtest/gtest.h>

#include "firmware-host/console/output_file.h"
#include "firmware-host/console/temporary_folder.h"
#include "firmware-host/result/result_json.h"
#include "hal/clock.h"
#include "tests/support/sample_run.h"

namespace bendloop::host {
namespace {

// A state directory whose daemon was killed, and the start of the next one.
class LastRun : public testing::Test {
 protected:
  // Its journal has a program of this session, as far as `step`.
  void Sent(const std::string& session, CommitStep step) {
    auto journal = CommitJournal::Open(store_->journal());
    ASSERT_TRUE(journal) << journal.error().message;
    CommitAttempt attempt;
    attempt.session = session;
    attempt.next.sequence = 8;
    attempt.next.program.rows = {{100, 0, 0, {}}};
    const auto id = journal->Begin(attempt);
    ASSERT_TRUE(id) << id.error().message;
    ASSERT_TRUE(journal->Append(*id, CommitStep::kCommitting, ""));
    ASSERT_TRUE(journal->Append(*id, step, "the guard was open"));
  }
  std::vector<HistoryPart> Start() {
    AlarmBoard alarms([] { return std::int64_t{0}; });
    config::CellConfig cell;
    cell.record.directory = folder_->path() / "state" / "sessions";
    PartKeeper keeper(*store_, cell, plan_, alarms);
    EXPECT_TRUE(keeper.Load(plan_));
    hal::SteadyClock clock;
    BenderDesk::Options options;
    options.journal = store_->journal();
    const auto desk = BenderDesk::Open(config::BenderConfig{}, options, clock);
    EXPECT_TRUE(desk) << desk.error().message;
    SettleWhatIsOpen(**desk, keeper, alarms);
    return *History::Open(store_->history())->Last(10);
  }

  const hal::Result<TemporaryFolder> folder_ = TemporaryFolder::Make();
  hal::Result<StateStore> store_ = StateStore::Open(folder_->path() / "state");
  PartPlan plan_;
};

TEST_F(LastRun, APartThatWasSentAndNotKeptIsInTheHistory) {
  Sent("part-0007", CommitStep::kCommitted);
  for (int start = 0; start < 2; ++start) {  // once
    const auto parts = Start();
    ASSERT_EQ(parts.size(), 1u);
    EXPECT_EQ(parts[0].result.session, "part-0007");
    EXPECT_EQ(parts[0].result.bender->outcome, CommitOutcome::kCommitted);
    EXPECT_EQ(parts[0].result.bender->sequence, 8u);
    EXPECT_FALSE(parts[0].result.inspection);
    EXPECT_EQ(parts[0].result.measurement.warnings.size(), 1u);
  }
}

TEST_F(LastRun, OneThatWasRefusedToo) {
  Sent("part-0007", CommitStep::kNotCommitted);
  const auto parts = Start();
  ASSERT_EQ(parts.size(), 1u);
  EXPECT_EQ(parts[0].result.bender->outcome, CommitOutcome::kRefused);
  EXPECT_EQ(parts[0].result.bender->reason, "the guard was open");
}

TEST_F(LastRun, WithItsResultWhereThatWasKept) {
  RunResult run = SampleRun(7);
  run.session = "part-0007";
  run.bender.reset();
  ASSERT_TRUE(WriteOutputFile(store_->results() / "part-0007.json", WriteResultJson(run)));
  Sent("part-0007", CommitStep::kCommitted);
  const auto parts = Start();
  ASSERT_EQ(parts.size(), 1u);
  EXPECT_EQ(parts[0].result.bender->sequence, 8u);
  EXPECT_EQ(parts[0].result.inspection->verdict, run.inspection->verdict);
}

TEST_F(LastRun, OneThatTheHistoryHasDroppedDoesNotComeBack) {
  Sent("part-0007", CommitStep::kCommitted);
  RunResult later = SampleRun(8);
  later.session = "part-0008";
  ASSERT_TRUE(History::Open(store_->history())->Add(later));
  EXPECT_EQ(Start().size(), 1u);
}

}  // namespace
}  // namespace bendloop::host
