// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/part_keeper.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "firmware-host/console/temporary_folder.h"
#include "tests/support/sample_run.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

// The first part of a lot, of which the disk takes nothing: what it has taught goes on, and is kept
// when the disk takes it.
TEST(PartKeeper, ALotThatTheDiskHasNeverTakenWasNotRemoved) {
  const auto folder = TemporaryFolder::Make();
  ASSERT_TRUE(folder);
  const fs::path state = folder->path() / "state", away = folder->path() / "away";
  auto store = StateStore::Open(state);
  ASSERT_TRUE(store);
  AlarmBoard alarms([] { return std::int64_t{0}; });
  config::CellConfig cell;
  cell.record.directory = state / "sessions";
  const PartPlan plan;
  PartKeeper keeper(*store, cell, plan, alarms);
  ASSERT_TRUE(keeper.Load(plan));
  PartOutcome outcome;
  outcome.result = SampleRun(1);
  outcome.next.emplace().parts = 1;
  fs::rename(state, away);
  keeper.Keep(std::move(outcome));
  EXPECT_TRUE(alarms.IsActive(AlarmCode::kLotNotKept));
  fs::rename(away, state);
  ASSERT_FALSE(store->HasLot(0));

  const auto lot = keeper.Lot(plan);
  ASSERT_TRUE(lot);
  EXPECT_EQ(lot->parts, 1u);
  EXPECT_FALSE(alarms.IsActive(AlarmCode::kLotRemoved));
  keeper.TryAgain();
  EXPECT_TRUE(store->HasLot(0));
  EXPECT_FALSE(alarms.IsActive(AlarmCode::kLotNotKept));

  // From now on who removes it begins a new one.
  fs::remove(state / "lot.json");
  EXPECT_FALSE(keeper.Lot(plan));
  EXPECT_TRUE(alarms.IsActive(AlarmCode::kLotRemoved));
}

}  // namespace
}  // namespace bendloop::host
