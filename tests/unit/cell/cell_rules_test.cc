// SPDX-License-Identifier: Apache-2.0
// What a cell file asks for beside what its bender and its service can give.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <string>

#include "firmware-host/cell/bender_follower.h"
#include "firmware-host/cell/service_needs.h"
#include "firmware-host/cell/service_times.h"
#include "firmware-host/cell/tube_rules.h"

namespace bendloop::host {
namespace {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

config::CellConfig Cell(config::BenderKind link) {
  config::CellConfig cell;
  cell.bender.link = link;
  cell.correction.enabled = true;
  return cell;
}

TEST(RemarksOn, PartsBetweenWithoutEffectAreSaid) {
  config::CellConfig cell = Cell(config::BenderKind::kSimulated);
  EXPECT_THAT(RemarksOn(cell, {}), IsEmpty());
  cell.scan.parts_between = 2;
  EXPECT_THAT(RemarksOn(cell, {}), ElementsAre(HasSubstr("parts_between has no effect")));
  cell.scan.tubes = config::TubeSource::kCounted;
  EXPECT_THAT(RemarksOn(cell, {}), IsEmpty());

  cell = Cell(config::BenderKind::kModbusTcp);  // and a map without a count
  cell.scan.parts_between.reset();
  EXPECT_THAT(RemarksOn(cell, {}), ElementsAre(HasSubstr("corrections are off"),
                                               HasSubstr("parts_between has no effect")));
  cell.bender.register_map.parts_bent.emplace();
  EXPECT_THAT(RemarksOn(cell, {}), IsEmpty());
  cell = Cell(config::BenderKind::kNone);
  cell.scan.parts_between = 1;
  EXPECT_THAT(RemarksOn(cell, {}), ElementsAre(HasSubstr("the cell has no bender")));
}

std::string ShippedText(const std::string& name) {
  std::ifstream file(BENDLOOP_SOURCE_DIR "/systemd/" + name);
  return {std::istreambuf_iterator<char>(file), {}};
}

TEST(ServiceTimes, AreThoseOfTheShippedUnit) {
  const std::string unit = ShippedText("bendloopd.service");
  const ServiceTimes shipped;
  const auto seconds = [](std::chrono::nanoseconds time) {
    return std::to_string(std::chrono::duration_cast<std::chrono::seconds>(time).count()) + "\n";
  };
  EXPECT_THAT(unit, HasSubstr("\nWatchdogSec=" + seconds(shipped.watchdog)));
  EXPECT_THAT(unit, HasSubstr("\nTimeoutStopSec=" + seconds(shipped.stop)));
  EXPECT_THAT(unit, HasSubstr("\nMemoryMax=" + std::to_string(kUnitMemoryMb) + "M\n"));
  EXPECT_TRUE(CheckWatchdog(shipped));
  // What the drivers open: scanners on USB, benders on serial lines.
  EXPECT_THAT(unit, HasSubstr("\nDevicePolicy=closed\n"));
  for (const char* device : {"usb_device", "ttyS", "ttyAMA", "ttyUSB", "ttyACM"}) {
    EXPECT_THAT(unit, HasSubstr("\nDeviceAllow=char-" + std::string(device) + " rw\n"));
  }
  EXPECT_THAT(ShippedText("bendloop.sysusers.conf"), HasSubstr("\nm bendloop dialout\n"));
}

TEST(ServiceTimes, AWatchdogThatACellThatIsWellCannotFeedIsRefused) {
  EXPECT_TRUE(CheckWatchdog({.watchdog = 0ns}));
  EXPECT_TRUE(CheckWatchdog({.watchdog = 200ms}));
  const auto refused = CheckWatchdog({.watchdog = 100ms});
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("found 100 ms, expected at least 200 ms"));
}

TEST(ServiceTimes, ACommitThatAStopWouldCutShortIsSaid) {
  config::CellConfig cell = Cell(config::BenderKind::kModbusTcp);
  cell.bender.register_map.parts_bent.emplace();
  EXPECT_THAT(RemarksOn(cell, {}), IsEmpty());
  cell.bender.commit_timeout = 15s;
  EXPECT_THAT(RemarksOn(cell, {}), ElementsAre(HasSubstr("raise TimeoutStopSec")));
  EXPECT_THAT(WhyStopIsTooShort(cell, {}), HasSubstr("ended after 20000 ms (as shipped)"));
  EXPECT_EQ(WhyStopIsTooShort(cell, {.stop = 60s}), "");
  EXPECT_THAT(RemarksOn(cell, {.stop = 60s}), IsEmpty());
  // The true figure, and the file that says so.
  EXPECT_THAT(RemarksOn(cell, {.stop = 3s, .stop_from = "/etc/x.conf"}),
              ElementsAre(HasSubstr("ended after 3000 ms (/etc/x.conf)")));
}

TEST(BenderFollower, LooksMoreOftenWhileACycleRuns) {
  BenderReading look;
  EXPECT_EQ(PauseAfter(look, 5s), 250ms);  // it did not answer
  look.facts.emplace();
  look.facts->state.mode = hal::BenderMode::kIdle;
  EXPECT_EQ(PauseAfter(look, 2ms), 250ms);
  look.facts->state.mode = hal::BenderMode::kBending;
  EXPECT_EQ(PauseAfter(look, 2ms), 50ms);
  EXPECT_EQ(PauseAfter(look, 120ms), 120ms);  // a slow line has as much rest as work
  EXPECT_EQ(PauseAfter(look, 900ms), 250ms);
}

}  // namespace
}  // namespace bendloop::host
