// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/plc_desk.h"

#include <gtest/gtest.h>

namespace bendloop::host {
namespace {

class PlcDeskTest : public testing::Test {
 protected:
  hal::CellReport Report(CellPhase phase = CellPhase::kWaiting, bool is_held = false) const {
    return desk_.Report(phase, 1001, is_held);
  }
  static hal::PlcOrders Asking(std::uint32_t new_lot, std::uint32_t acknowledge) {
    hal::PlcOrders orders;
    orders.new_lot = new_lot;
    orders.acknowledge = acknowledge;
    return orders;
  }
  static PartOutcome Outcome(const std::string& session, pipeline::Verdict verdict) {
    PartOutcome outcome;
    outcome.part_number = 1002;
    outcome.result.session = session;
    outcome.result.identity = "T-1";
    outcome.result.inspection.emplace();
    outcome.result.inspection->verdict = verdict;
    pipeline::RowInspection row;
    row.angle_deg = {90, 90.4, 0.4, 0.01, 0.5, pipeline::ToleranceState::kIn};
    outcome.result.inspection->rows = {row};
    return outcome;
  }

  AlarmBoard alarms_{[] { return std::int64_t{1}; }};
  PlcDesk desk_{alarms_};
};

TEST_F(PlcDeskTest, AsksByChangingAndNotByWhatStandsThereAtTheStart) {
  EXPECT_FALSE(desk_.Heard(Asking(4, 9)));
  EXPECT_FALSE(desk_.AsksForLot());
  EXPECT_TRUE(desk_.Heard(Asking(5, 10)));
  EXPECT_TRUE(desk_.AsksForLot());
  desk_.Acknowledged();
  desk_.LotBegun();
  EXPECT_EQ(Report().acknowledged, 10u);
  EXPECT_EQ(Report().lot_begun, 5u);
  EXPECT_FALSE(desk_.Heard(Asking(5, 10)));
  EXPECT_FALSE(desk_.AsksForLot());
  // A bit that is set, told back, and taken back asks again when it is set again.
  EXPECT_FALSE(desk_.Heard(Asking(0, 0)));
  EXPECT_EQ(Report().acknowledged, 0u);
  EXPECT_TRUE(desk_.Heard(Asking(5, 10)));
  EXPECT_TRUE(desk_.AsksForLot());
}

TEST_F(PlcDeskTest, CountsATubeOnceAndTellsTheLastOne) {
  desk_.Done(Outcome("part-0007", pipeline::Verdict::kPass));
  desk_.Done(Outcome("part-0007", pipeline::Verdict::kPass));  // it waited
  PartOutcome again = Outcome("part-0008", pipeline::Verdict::kFail);
  again.end = PartEnd::kRepeat;
  desk_.Done(again);
  desk_.Failed({{"part-0009", "", "T-9"}, {hal::ErrorKind::kRefused, "no such part"}, 100}, 0);
  const hal::CellReport report = Report();
  EXPECT_EQ(report.sequence, 9u);
  EXPECT_EQ(report.verdict, hal::TubeVerdict::kHeld);
  EXPECT_EQ(report.identity, "T-9");
  EXPECT_EQ(report.tubes, 2u);
  EXPECT_EQ(report.passed, 1u);
  EXPECT_EQ(report.held, 1u);
  // Overtaken while it waited: the last tube is another one.
  desk_.Done(Outcome("part-0007", pipeline::Verdict::kPass));
  EXPECT_EQ(Report().sequence, 9u);
}

TEST_F(PlcDeskTest, AMeasurementThatIsNotToBeTrustedIsHeld) {
  PartOutcome outcome = Outcome("part-0001", pipeline::Verdict::kPass);
  EXPECT_EQ(WorstPercent(outcome.result), 80u);
  outcome.result.interlocks.emplace();
  auto& checks = outcome.result.interlocks->checks;
  checks = {{pipeline::InterlockKind::kBenderReady, false, 0, 0, "busy"}};
  EXPECT_EQ(VerdictOf(outcome.result), hal::TubeVerdict::kPass);
  checks.push_back({pipeline::InterlockKind::kGap, false, 70, 60, "a gap"});
  EXPECT_EQ(VerdictOf(outcome.result), hal::TubeVerdict::kHeld);
}

TEST_F(PlcDeskTest, StateAndAlarmFollowTheMostSevere) {
  EXPECT_EQ(Report().state, hal::CellState::kIdle);
  EXPECT_EQ(Report(CellPhase::kWaiting, true).state, hal::CellState::kHeld);
  alarms_.Begin(AlarmCode::kNoRealtime);
  EXPECT_EQ(Report().alarm, 0u);
  alarms_.Begin(AlarmCode::kBenderAway);
  EXPECT_EQ(Report().alarm, 4001u);
  EXPECT_EQ(Report().alarms, 1u);
  EXPECT_EQ(Report(CellPhase::kWaiting, true).state, hal::CellState::kFault);
  EXPECT_EQ(Report(CellPhase::kScanning).state, hal::CellState::kScanning);
  EXPECT_EQ(Report(CellPhase::kCommitting).state, hal::CellState::kCommitting);
}

}  // namespace
}  // namespace bendloop::host
