// SPDX-License-Identifier: Apache-2.0
// What an appliance tells of itself: shifts, a clock that was set, neighbours that take its
// machine.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "firmware-host/daemon/clock_watch.h"
#include "firmware-host/daemon/machine_load.h"
#include "firmware-host/daemon/neighbour_watch.h"
#include "firmware-host/daemon/shift_log.h"

namespace bendloop::host {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;

TEST(ShiftLog, SaysOnceWhatWasDone) {
  AlarmBoard alarms([] { return std::int64_t{0}; });
  alarms.Begin(AlarmCode::kBenderAway);
  CellSnapshot cell;
  cell.disk_used_mb = 3900;
  cell.disk_free_mb = 21000;
  ShiftLog shift(8h, 100s);
  EXPECT_FALSE(shift.IsDue(100s + 8h - 1s));
  EXPECT_TRUE(shift.IsDue(100s + 8h));
  for (int i = 1; i <= 9; ++i) shift.PartDone(i < 8 ? "pass" : "fail", i % 2 == 0, i, 10 * i);
  shift.PartDone("", false, 0, 0);
  cell.removed_sessions = 4;
  EXPECT_EQ(shift.Take(100s + 8h, cell, alarms),
            "shift hours=8.0 parts=10 pass=7 fail=2 undecided=0 not_judged=1 corrected=4"
            " lra_ms_p50=5.0 lra_ms_max=9.0 end_ms_p50=50.0 end_ms_max=90.0 alarms=BL4001:1"
            " active=1 sessions_mb=3900 free_mb=21000 removed_sessions=4 not_recorded=0");
  // The next one counts from there.
  EXPECT_FALSE(shift.IsDue(100s + 9h));
  // Without a part, too: the bender is still away, which began in the shift before.
  EXPECT_FALSE(shift.IsIdle(alarms));
  EXPECT_EQ(shift.Take(100s + 16h, cell, alarms),
            "shift hours=8.0 parts=0 pass=0 fail=0 undecided=0 not_judged=0 corrected=0"
            " alarms=none active=1 sessions_mb=3900 free_mb=21000 removed_sessions=0"
            " not_recorded=0");
  alarms.End(AlarmCode::kBenderAway);
  EXPECT_TRUE(shift.IsIdle(alarms));
  alarms.Begin(AlarmCode::kBenderAway);
  alarms.End(AlarmCode::kBenderAway);
  EXPECT_FALSE(shift.IsIdle(alarms));
  EXPECT_THAT(shift.Take(100s + 24h, cell, alarms), HasSubstr("alarms=BL4001:1 active=0"));
  EXPECT_TRUE(shift.IsIdle(alarms));
  EXPECT_FALSE(ShiftLog(0h, 0s).IsDue(1000h));
}

TEST(ClockWatch, TellsASetClockFromOneThatRuns) {
  ClockWatch watch;
  constexpr std::int64_t kYearMs = 365LL * 24 * 3'600'000;
  Moment now{5'000'000'000, 1'795'359'180'000};
  const auto after = [&](std::int64_t boot_ms, std::int64_t wall_ms) {
    now.boot_ns += boot_ms * 1'000'000;
    now.unix_ms += wall_ms;
    return watch.Step(now);
  };
  EXPECT_FALSE(after(0, 0));
  EXPECT_FALSE(after(kYearMs, kYearMs));  // however long nobody looked
  EXPECT_FALSE(after(1000, 1900));        // a time server's correction
  EXPECT_NEAR(after(1000, kYearMs).value(), 8760, 0.01);
  EXPECT_FALSE(after(1000, 1000));  // once
  EXPECT_NEAR(after(1000, -2 * kYearMs).value(), -2 * 8760, 0.01);
}

// A machine of two processors, looked at every 5 s.
class NeighbourWatchTest : public ::testing::Test {
 protected:
  // For so long; the daemon itself takes so much of a processor.
  void Pass(std::chrono::seconds time, double own = 0) {
    for (const auto end = now_ + time; now_ < end;) {
      EXPECT_TRUE(watch_.IsDue(now_));
      watch_.Look(now_, load_);
      EXPECT_FALSE(watch_.IsDue(now_ + 4s));
      now_ += 5s;
      load_.own_cpu_s += 5 * own;
    }
  }
  void Swap(std::uint64_t mb) { load_.swapped_bytes = mb << 20; }

  NeighbourWatch watch_;
  MachineLoad load_{.processors = 2};
  std::chrono::nanoseconds now_ = 3h;
};

TEST_F(NeighbourWatchTest, TellsOfOthersThatWantAllProcessorsForAMinute) {
  load_.wanted = 2.3;
  Pass(60s);
  EXPECT_FALSE(watch_.crowded());
  Pass(5s);
  EXPECT_EQ(watch_.crowded(), "others want 2.3 of 2 processors");
  load_.wanted = 1.5;  // not yet over
  Pass(5s);
  EXPECT_TRUE(watch_.crowded());
  load_.wanted = 1.3;
  Pass(5s);
  EXPECT_FALSE(watch_.crowded());
  load_.wanted = 1.7;  // not enough to begin
  Pass(600s);
  EXPECT_FALSE(watch_.crowded());
}

TEST_F(NeighbourWatchTest, ItsOwnWorkIsNoNeighbour) {
  load_.wanted = 0.5;
  Pass(300s, 0.5);
  load_.wanted = 2.2;
  Pass(600s, 0.5);
  EXPECT_FALSE(watch_.crowded());
  load_.wanted = 2.5;
  Pass(600s, 0.5);
  EXPECT_EQ(watch_.crowded(), "others want 2.0 of 2 processors");
}

TEST_F(NeighbourWatchTest, TellsThatMemoryIsSwappedOutUntilAMinuteWithout) {
  Swap(300);  // since long ago
  Pass(600s);
  EXPECT_FALSE(watch_.swaps());
  for (std::uint64_t mb = 300; mb < 312; ++mb) {  // what nobody asks for, slowly
    Swap(mb);
    Pass(60s);
    EXPECT_FALSE(watch_.swaps()) << mb;
  }
  Swap(400);
  load_.own_swapped_bytes = 3u << 20;
  Pass(5s);
  EXPECT_EQ(watch_.swaps(), "400 MB are swapped out, 3 MB of them this daemon's");
  Pass(55s);
  EXPECT_TRUE(watch_.swaps());
  Pass(10s);
  EXPECT_FALSE(watch_.swaps());
  Swap(100);  // taken in again, and out
  Pass(5s);
  Swap(130);
  Pass(5s);
  EXPECT_TRUE(watch_.swaps());
}

TEST(MachineLoad, IsThatOfThisMachine) {
  const MachineLoad load = LookAtMachine();
  EXPECT_GE(load.processors, 1u);
  EXPECT_GT(load.own_cpu_s, 0);
  EXPECT_GE(load.wanted, 0);
  EXPECT_LE(load.own_swapped_bytes, load.swapped_bytes);
}

}  // namespace
}  // namespace bendloop::host
