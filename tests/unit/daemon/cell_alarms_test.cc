// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/cell_alarms.h"

#include <gtest/gtest.h>

namespace bendloop::host {
namespace {

// While its correction waits for the journal, which a full disk has stopped, nobody calls Look.
TEST(CellAlarms, TellOfAFullDiskWhenThePartIsDone) {
  CellAlarms alarms;
  CellSnapshot cell;
  cell.knows_disk = true;
  cell.disk_free_mb = 0;
  alarms.PartDone({}, cell);
  EXPECT_TRUE(alarms.board().IsActive(AlarmCode::kDiskFull));
  cell.disk_free_mb = 10000;
  alarms.PartDone({}, cell);
  EXPECT_FALSE(alarms.board().IsActive(AlarmCode::kDiskFull));
}

// It has room, and no file can be made in it.
TEST(CellAlarms, TellOfADiskWithoutInodes) {
  CellAlarms alarms;
  CellSnapshot cell;
  cell.knows_disk = true;
  cell.disk_free_mb = 10000;
  cell.disk_free_names = 12;
  alarms.Look(cell);
  ASSERT_TRUE(alarms.board().IsActive(AlarmCode::kDiskFull));
  EXPECT_EQ(alarms.board().Active().front().detail, "10000 MB and 12 files (inodes) are free");
  cell.disk_free_names = 5000;
  alarms.Look(cell);
  EXPECT_FALSE(alarms.board().IsActive(AlarmCode::kDiskFull));
}

// A recording that has begun, or found no memory, has not looked at the disk yet.
TEST(CellAlarms, TellOfADiskThatWasFullFromTheStart) {
  CellAlarms alarms;
  CellSnapshot cell;
  cell.recorded_sessions = 1;
  cell.recorder_dropped_sessions = 1;
  alarms.Look(cell);
  EXPECT_FALSE(alarms.board().IsActive(AlarmCode::kDiskFull));
  cell.knows_disk = true;
  alarms.Look(cell);
  EXPECT_TRUE(alarms.board().IsActive(AlarmCode::kDiskFull));
}

}  // namespace
}  // namespace bendloop::host
