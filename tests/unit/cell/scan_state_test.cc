// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/scan_state.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace bendloop::host {
namespace {

using hal::ScanEventKind;
using ::testing::HasSubstr;

hal::ScanEvent Event(ScanEventKind kind, const char* detail = "") {
  hal::ScanEvent event;
  event.kind = kind;
  event.set_detail(detail);
  return event;
}

hal::LaserProfile Profile(std::uint64_t sequence, double seconds = 0) {
  hal::LaserProfile profile(4);
  profile.sequence = sequence;
  profile.t_ns = static_cast<std::int64_t>(seconds * 1e9);
  profile.points.resize(3);
  return profile;
}

ScanRules Rules(bool is_live) {
  ScanRules rules;
  rules.is_live = is_live;
  rules.min_profiles = 3;
  rules.max_seconds = 60;
  return rules;
}

TEST(ScanState, FollowsTheScannersEvents) {
  ScanState scan(Rules(true));
  EXPECT_EQ(scan.Take(Profile(7)), ScanStep::kNothing);
  EXPECT_EQ(scan.ignored_profiles(), 1u);
  EXPECT_EQ(scan.Take(Event(ScanEventKind::kScanEnd)), ScanStep::kNothing);
  EXPECT_EQ(scan.Take(Event(ScanEventKind::kScanStart)), ScanStep::kBegan);
  for (std::uint64_t i = 10; i < 14; ++i) EXPECT_EQ(scan.Take(Profile(i)), ScanStep::kGrew);
  EXPECT_EQ(scan.Take(Event(ScanEventKind::kButton)), ScanStep::kGrew);
  EXPECT_EQ(scan.Take(Event(ScanEventKind::kScanEnd)), ScanStep::kEnded);
  EXPECT_EQ(scan.profiles(), 4u);
  EXPECT_EQ(scan.points(), 12u);
  EXPECT_EQ(scan.lost_profiles(), 0u);
  EXPECT_EQ(scan.phase(), ScanPhase::kWaiting);
}

TEST(ScanState, ARecordingWithoutEventsIsOneScan) {
  ScanState scan(Rules(false));
  EXPECT_EQ(scan.Take(Profile(0)), ScanStep::kBegan);
  for (std::uint64_t i = 1; i < 5; ++i) EXPECT_EQ(scan.Take(Profile(i)), ScanStep::kGrew);
  EXPECT_EQ(scan.TakeEnd(), ScanStep::kEnded);
  EXPECT_EQ(scan.TakeEnd(), ScanStep::kNothing);
}

TEST(ScanState, CountsWhatIsMissing) {
  ScanState scan(Rules(false));
  for (const std::uint64_t i : {100, 101, 105, 104, 110}) scan.Take(Profile(i));
  EXPECT_EQ(scan.lost_profiles(), 6u);
}

// A late profile may have a smaller number than the first that came.
TEST(ScanState, NumbersBelowTheFirstHideNoLoss) {
  ScanState scan(Rules(false));
  for (const std::uint64_t i : {100, 101, 105, 98, 97}) scan.Take(Profile(i));
  EXPECT_EQ(scan.lost_profiles(), 4u);  // 99, 102, 103, 104
  for (const std::uint64_t i : {97, 98, 100, 105}) {
    EXPECT_EQ(scan.Take(Profile(i)), ScanStep::kNothing) << i;
  }
  EXPECT_EQ(scan.repeated_profiles(), 4u);
  EXPECT_EQ(scan.lost_profiles(), 4u);
  scan.Take(Profile(99));
  EXPECT_EQ(scan.lost_profiles(), 3u);
}

TEST(ScanState, AScannerThatCountsAnewInTheScanHasLostManyProfiles) {
  ScanState scan(Rules(false));
  for (std::uint64_t i = 1000; i < 1100; ++i) scan.Take(Profile(i));
  for (std::uint64_t i = 0; i < 100; ++i) scan.Take(Profile(i));
  EXPECT_EQ(scan.lost_profiles(), 900u);
}

TEST(ScanState, NumbersThatCountDownOrLieFarApartAreCounted) {
  ScanState down(Rules(false));
  for (std::uint64_t i = 50'000; i-- > 0;) down.Take(Profile(i));
  EXPECT_EQ(down.lost_profiles(), 0u);
  EXPECT_EQ(down.profiles(), 50'000u);
  EXPECT_EQ(down.Take(Profile(0)), ScanStep::kNothing);

  ScanState wide(Rules(false));
  wide.Take(Profile(1u << 30));
  wide.Take(Profile(0));
  EXPECT_EQ(wide.lost_profiles(), (1u << 30) - 1);
  wide.Take(Profile(UINT64_MAX));
  EXPECT_EQ(wide.lost_profiles(), UINT64_MAX - 2);
}

TEST(ScanState, AGapStandsBeforeWhatCameAfterIt) {
  EXPECT_EQ(GapEvent(1000, 3, "why").t_ns, 999);
  EXPECT_EQ(GapEvent(INT64_MIN, 3, "why").t_ns, INT64_MIN);
}

TEST(ScanState, ASecondStartBeginsAnew) {
  ScanState scan(Rules(true));
  scan.Take(Event(ScanEventKind::kScanStart));
  for (std::uint64_t i = 0; i < 10; ++i) scan.Take(Profile(i));
  EXPECT_EQ(scan.Take(Event(ScanEventKind::kScanStart)), ScanStep::kBegan);
  EXPECT_EQ(scan.profiles(), 0u);
}

TEST(ScanState, AScanTooShortIsNone) {
  ScanState scan(Rules(true));
  scan.Take(Event(ScanEventKind::kScanStart));
  scan.Take(Profile(0));
  EXPECT_EQ(scan.Take(Event(ScanEventKind::kScanEnd)), ScanStep::kBroke);
  EXPECT_THAT(scan.reason(), HasSubstr("1 profiles, expected at least 3"));
}

TEST(ScanState, AScanTooLongBreaksByItsOwnTimes) {
  ScanState scan(Rules(true));
  scan.Take(Event(ScanEventKind::kScanStart));
  EXPECT_EQ(scan.Take(Profile(0, 1000)), ScanStep::kGrew);
  EXPECT_EQ(scan.Take(Profile(1, 1060)), ScanStep::kGrew);
  EXPECT_EQ(scan.Take(Profile(2, 1060.1)), ScanStep::kBroke);
  EXPECT_THAT(scan.reason(), HasSubstr("60 s"));
  EXPECT_EQ(scan.Take(Profile(3, 1061)), ScanStep::kNothing);
}

TEST(ScanState, TheScannersFaultBreaksTheScan) {
  ScanState scan(Rules(true));
  EXPECT_EQ(scan.Take(Event(ScanEventKind::kFault, "laser off")), ScanStep::kNothing);
  scan.Take(Event(ScanEventKind::kScanStart));
  EXPECT_EQ(scan.Take(Event(ScanEventKind::kFault, "laser off")), ScanStep::kBroke);
  EXPECT_THAT(scan.reason(), HasSubstr("laser off"));
  EXPECT_EQ(scan.Break("again"), ScanStep::kNothing);
}

}  // namespace
}  // namespace bendloop::host
