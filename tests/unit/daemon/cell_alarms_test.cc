// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/cell_alarms.h"

#include <gtest/gtest.h>

namespace bendloop::host {
namespace {

// While its correction waits for the journal, which a full disk has stopped, nobody calls Look.
TEST(CellAlarms, TellOfAFullDiskWhenThePartIsDone) {
  CellAlarms alarms;
  CellSnapshot cell;
  cell.recorded_sessions = 1;
  cell.disk_free_mb = 0;
  alarms.PartDone({}, cell);
  EXPECT_TRUE(alarms.board().IsActive(AlarmCode::kDiskFull));
  cell.disk_free_mb = 10000;
  alarms.PartDone({}, cell);
  EXPECT_FALSE(alarms.board().IsActive(AlarmCode::kDiskFull));
}

TEST(CellAlarms, TellOfADiskThatWasFullFromTheStart) {
  CellAlarms alarms;
  CellSnapshot cell;  // nothing was recorded: nobody has looked at the disk
  alarms.Look(cell);
  EXPECT_FALSE(alarms.board().IsActive(AlarmCode::kDiskFull));
  cell.recorder_dropped_sessions = 1;
  alarms.Look(cell);
  EXPECT_TRUE(alarms.board().IsActive(AlarmCode::kDiskFull));
}

}  // namespace
}  // namespace bendloop::host
