// SPDX-License-Identifier: Apache-2.0
// Tubes that are not the part's, and scans that are not to be believed, through the whole daemon:
// nothing is corrected or learnt from them, and why is said.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "live_cell.h"

namespace bendloop::testing {
namespace {

using pipeline::InterlockKind;
using ::testing::HasSubstr;

bool IsHeldFor(const host::RunResult& result, InterlockKind kind) {
  if (!result.interlocks) return false;
  for (const pipeline::Interlock& check : result.interlocks->checks) {
    if (check.kind == kind && !check.passed) return true;
  }
  return false;
}

// What was bent is of no matter: another tube is scanned.
class DoubtsCell : public LiveCell {
 public:
  DoubtsCell() {
    profile_spacing_mm = 2;
    StartDaemon();
  }
  host::RunResult Held(std::shared_ptr<const drivers::VirtualScan> scan) {
    Bend();
    Trigger(std::move(scan));
    return Next();
  }
  host::RunResult Next() {
    auto result = Result(++number_, "refused");
    EXPECT_EQ(bender().commits_accepted(), 0u);
    EXPECT_FALSE(std::filesystem::exists(scratch() / "state/lot.json"));
    return result ? std::move(*result) : host::RunResult{};
  }

 private:
  unsigned number_ = 0;
};

TEST(DoubtsCell, AnotherPartThanTheNominalsIsHeldAndSaidToBeOne) {
  DoubtsCell cell;
  const hal::BendProgram part = cell.plan().nominal;

  hal::BendProgram fewer = part;
  fewer.rows[1].length_mm += 30 + fewer.rows[2].length_mm;
  fewer.rows.erase(fewer.rows.begin() + 2);
  auto held = cell.Held(cell.ScanOf(fewer));
  EXPECT_TRUE(IsHeldFor(held, InterlockKind::kBendCount));
  EXPECT_THAT(held.bender->reason, HasSubstr("measured 3 bends, the nominal has 4"));
  EXPECT_TRUE(cell.HasAlarm("BL2002")) << cell.log();

  hal::BendProgram more = part;
  more.rows.insert(more.rows.begin() + 2, {50, 30, 25, 20});
  held = cell.Held(cell.ScanOf(more));
  EXPECT_TRUE(IsHeldFor(held, InterlockKind::kBendCount));
  EXPECT_THAT(held.bender->reason, HasSubstr("measured 5 bends, the nominal has 4"));

  hal::BendProgram mirrored = part;
  for (hal::BendRow& row : mirrored.rows) row.rotation_deg = -row.rotation_deg;
  held = cell.Held(cell.ScanOf(mirrored));
  EXPECT_TRUE(IsHeldFor(held, InterlockKind::kDirection));
  EXPECT_THAT(held.bender->reason, HasSubstr("mirror"));
  EXPECT_TRUE(cell.HasAlarm("BL2003")) << cell.log();

  hal::BendProgram other = part;
  other.rows[1].angle_deg = 50;
  held = cell.Held(cell.ScanOf(other));
  EXPECT_TRUE(IsHeldFor(held, InterlockKind::kDirection));

  held = cell.Held(cell.ScanOf(part, 5.0));
  EXPECT_TRUE(IsHeldFor(held, InterlockKind::kPipeRadius));
  EXPECT_THAT(held.bender->reason, HasSubstr("nominal 4.000 mm"));
  EXPECT_TRUE(cell.HasAlarm("BL2007")) << cell.log();
}

TEST(DoubtsCell, ATubeThatWasMovedBetweenPassesIsHeldAndItsPassesAreTold) {
  DoubtsCell cell;
  for (const Eigen::Vector3d& move_mm :
       {Eigen::Vector3d(0.6, 0.6, 0.5), Eigen::Vector3d(0, 0, 1)}) {
    cell.TriggerMoved(cell.Bend(), move_mm);
    const auto held = cell.Next();
    EXPECT_TRUE(IsHeldFor(held, InterlockKind::kPasses));
    EXPECT_THAT(held.interlocks->refusals(),
                ::testing::Contains(HasSubstr("the tube was moved while it was scanned")));
    EXPECT_TRUE(cell.HasAlarm("BL2012")) << cell.log();
  }
  const auto shown = cell.scratch().Bendloop("status --config " + cell.cell_file());
  EXPECT_THAT(shown.out, HasSubstr("last part passes apart mm"));
  EXPECT_THAT(cell.log(), HasSubstr("passes part=part-0001 count=2 furthest="));
  // The next one that lies still is corrected.
  cell.Trigger(cell.Bend());
  const auto next = cell.Result(3, "committed");
  EXPECT_TRUE(next && next->measurement.passes.empty());
  EXPECT_TRUE(cell.HasAlarm("BL2012", "alarms_ended")) << cell.log();
}

}  // namespace
}  // namespace bendloop::testing
