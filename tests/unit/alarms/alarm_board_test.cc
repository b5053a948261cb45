// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/alarms/alarm_board.h"

#include <gtest/gtest.h>

#include "firmware-host/alarms/alarm_text.h"
#include "firmware-host/alarms/part_alarms.h"
#include "firmware-host/history/history.h"
#include "tests/support/sample_run.h"

namespace bendloop::host {
namespace {

class AlarmBoardTest : public testing::Test {
 protected:
  std::vector<std::string> Codes() const {
    std::vector<std::string> codes;
    for (const Alarm& alarm : board_.Active()) codes.push_back(CodeText(alarm.code));
    return codes;
  }
  using Texts = std::vector<std::string>;

  std::int64_t now_ms_ = 1'000'000;
  std::vector<Alarm> heard_;
  AlarmBoard board_{[this] { return now_ms_; },
                    [this](const Alarm& alarm) { heard_.push_back(alarm); }};
};

TEST_F(AlarmBoardTest, BeginsOnceAndEndsOnce) {
  board_.Begin(AlarmCode::kScannerAway, "unplugged");
  now_ms_ += 5000;
  board_.Begin(AlarmCode::kScannerAway, "refused");
  ASSERT_EQ(board_.Active().size(), 1u);
  EXPECT_EQ(board_.Active()[0].detail, "refused");
  EXPECT_EQ(board_.Active()[0].began_ms, 1'000'000);
  board_.End(AlarmCode::kScannerAway);
  board_.End(AlarmCode::kScannerAway);
  EXPECT_TRUE(board_.Active().empty());
  ASSERT_EQ(board_.Recent().size(), 1u);
  EXPECT_EQ(board_.Recent()[0].ended_ms, 1'005'000);
  EXPECT_EQ(heard_.size(), 2u);
  EXPECT_EQ(board_.Count(AlarmCode::kScannerAway), 1u);
}

TEST_F(AlarmBoardTest, TheMostSevereComesFirstThenTheOldest) {
  board_.Begin(AlarmCode::kLotHeld);
  board_.Begin(AlarmCode::kBenderFault);
  board_.Begin(AlarmCode::kScanBroken);
  board_.Begin(AlarmCode::kBenderAway);
  EXPECT_EQ(Codes(), (Texts{"BL4001", "BL4003", "BL1003", "BL3010"}));
}

TEST_F(AlarmBoardTest, APartEndsWhatThePartBeforeHadToComplainOf) {
  board_.Begin(AlarmCode::kScannerAway);
  board_.SetOfPart({{AlarmCode::kGap, "part-0001"}, {AlarmCode::kFit, "part-0001"}});
  board_.SetOfPart({{AlarmCode::kFit, "part-0002"}});
  EXPECT_EQ(Codes(), (Texts{"BL1001", "BL2006"}));
  board_.SetOfPart({});
  EXPECT_EQ(Codes(), (Texts{"BL1001"}));
}

TEST_F(AlarmBoardTest, AcknowledgingEndsWhatIsOverAndNothingElse) {
  board_.Begin(AlarmCode::kRulesBroken);
  board_.Begin(AlarmCode::kBenderAway);
  board_.SetOfPart({{AlarmCode::kGap, ""}});
  board_.End(AlarmCode::kRulesBroken);
  board_.SetOfPart({});
  EXPECT_EQ(Codes(), (Texts{"BL4002", "BL4001"}));
  board_.Acknowledge();
  EXPECT_EQ(Codes(), (Texts{"BL4001"}));
  EXPECT_EQ(board_.Active()[0].acknowledged, 1u);
}

TEST_F(AlarmBoardTest, MemoryIsBounded) {
  for (int i = 0; i < 1000; ++i) {
    board_.Begin(AlarmCode::kScannerAway);
    board_.End(AlarmCode::kScannerAway);
  }
  EXPECT_EQ(board_.Recent().size(), AlarmBoard::kRecent);
  EXPECT_EQ(board_.Count(AlarmCode::kScannerAway), 1000u);
}

TEST_F(AlarmBoardTest, ALineOfTheLogHasFields) {
  Alarm alarm{AlarmCode::kScannerAway, "says \"no\"", 1'700'000'000'000, 0, 0};
  const std::string began = LogLine(alarm);
  EXPECT_EQ(began.find("alarm=BL1001 event=began severity=fault text=\""), 0u) << began;
  EXPECT_NE(began.find(R"( detail="says \"no\"" mend=")"), std::string::npos) << began;
  alarm.ended_ms = alarm.began_ms + 1;
  EXPECT_NE(LogLine(alarm).find("event=ended"), std::string::npos);
}

TEST_F(AlarmBoardTest, StatusAndMetricsShowThem) {
  board_.Begin(AlarmCode::kScannerSilent, "detail");
  board_.SetOfPart({});
  board_.Begin(AlarmCode::kScannerAway, "unplugged");
  Json status;
  ShowAlarms(board_, status);
  EXPECT_EQ(status.at("alarms").at(0).at("code"), "BL1001");
  EXPECT_EQ(status.at("alarms").at(0).at("severity"), "fault");
  EXPECT_EQ(status.at("alarms_ended").at(0).at("code"), "BL1002");
  EXPECT_NE(AlarmLines(status).find("(unplugged)"), std::string::npos);
  const std::string metrics = AlarmMetrics(board_);
  EXPECT_NE(metrics.find("bendloop_alarm_active{code=\"BL1001\",severity=\"fault\"} 1\n"),
            std::string::npos);
  EXPECT_NE(metrics.find("bendloop_alarms_total{code=\"BL1002\",severity=\"warning\"} 1\n"),
            std::string::npos);
}

TEST_F(AlarmBoardTest, TheHistoryKeepsThem) {
  auto history = History::Open(":memory:", {.most_alarms = 3});
  ASSERT_TRUE(history) << history.error().message;
  for (int i = 0; i < 5; ++i) {
    board_.Begin(AlarmCode::kScannerAway, "away");
    now_ms_ += 1000;
    board_.End(AlarmCode::kScannerAway);
  }
  board_.Begin(AlarmCode::kBenderAway);
  for (const Alarm& alarm : heard_) ASSERT_TRUE(history->NoteAlarm(alarm));
  auto kept = history->LastAlarms(10);
  ASSERT_TRUE(kept) << kept.error().message;
  ASSERT_EQ(kept->size(), 3u);
  EXPECT_EQ((*kept)[0].ended_ms - (*kept)[0].began_ms, 1000);
  EXPECT_TRUE((*kept)[2].is_active());
  ASSERT_TRUE(history->EndAlarms(now_ms_ + 1000));
  kept = history->LastAlarms(1);
  ASSERT_TRUE(kept && kept->size() == 1);
  EXPECT_EQ((*kept)[0].code, AlarmCode::kBenderAway);
  EXPECT_FALSE((*kept)[0].is_active());
}

// A held part says by number what its sentences say.
TEST(PartAlarms, AHeldPartHasTheAlarmsOfItsInterlocks) {
  RunResult run = SampleRun(1);
  run.interlocks.emplace();
  run.interlocks->checks = {{pipeline::InterlockKind::kGap, false, 70, 60, "a gap of 70 mm"},
                            {pipeline::InterlockKind::kFit, true, 0, 0, "fits"}};
  run.measurement.warnings.clear();
  run.correction.reset();
  run.bender.reset();
  RaisedAlarms alarms = AlarmsOf(run);
  const auto has = [&](AlarmCode code) {
    return std::any_of(alarms.begin(), alarms.end(),
                       [code](const auto& alarm) { return alarm.first == code; });
  };
  EXPECT_TRUE(has(AlarmCode::kGap));
  EXPECT_FALSE(has(AlarmCode::kFit));
  // A tube that is scanned again was decided of before.
  run.repeat_of = "part-0001";
  alarms = AlarmsOf(run);
  EXPECT_FALSE(has(AlarmCode::kGap));
}

}  // namespace
}  // namespace bendloop::host
