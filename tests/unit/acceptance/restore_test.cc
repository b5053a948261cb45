// SPDX-License-Identifier: Apache-2.0
//
// Whatever the robot did when it was cut, the next run puts back the program that it found.
#include "firmware-host/acceptance/restore.h"

#include <gtest/gtest.h>

#include <fstream>

#include "firmware-host/acceptance/robot.h"
#include "tests/unit/acceptance/memory_plc.h"
#include "tests/unit/acceptance/simulated_cell.h"

namespace bendloop::test {
namespace {

hal::ProgramBlock Program(std::uint32_t sequence) {
  hal::ProgramBlock program = SimulatorOptions(PlainMap()).program;
  program.sequence = sequence;
  return program;
}

// A run that the line ends after so many writes. False: it came to its end.
bool RunAndCut(MemoryPlc& cell, const host::RestoreFile& file, std::size_t writes) {
  cell.CutAfterWrites(writes);
  host::Plc plc(PlainMap(), cell.Carrier(), cell.clock());
  host::NoHands nobody;
  const auto result = host::RunAcceptance(plc, file, nobody, {.bench = QuickBench()});
  EXPECT_TRUE(result);
  if (!cell.is_cut()) return false;
  EXPECT_FALSE(result->restored);
  EXPECT_FALSE(result->passed());
  EXPECT_TRUE(std::filesystem::exists(file.path()));
  return true;
}

void CutEverywhere(std::uint32_t sequence, std::size_t stride) {
  const TemporaryFolder folder;
  const host::RestoreFile file(folder.path() / "acceptance.json");
  bool cut = true;
  for (std::size_t writes = 0; cut; writes += stride) {
    SCOPED_TRACE(writes);
    MemoryPlc cell(PlainMap(), Program(sequence));
    const hal::ProgramBlock found = cell.memory().Active().value();
    cut = RunAndCut(cell, file, writes);
    if (cut) {
      cell.Mend();
      host::Plc plc(PlainMap(), cell.Carrier(), cell.clock());
      const auto restored = host::RestoreAfterCut(plc, file, QuickBench());
      ASSERT_TRUE(restored) << restored.error().message;
    }
    EXPECT_FALSE(std::filesystem::exists(file.path()));
    const hal::ProgramBlock active = cell.memory().Active().value();
    EXPECT_EQ(active.program, found.program);
    EXPECT_EQ(active.part_number, found.part_number);
    // A program that was keyed in has no number to be put back with.
    if (sequence != 0) {
      EXPECT_EQ(active, found);
    }
    EXPECT_EQ(cell.memory().Staged()->sequence, 0u);
    if (testing::Test::HasFailure()) return;
  }
}

TEST(AcceptanceRestore, PutsBackTheProgramAfterACutAtEveryWrite) { CutEverywhere(3, 1); }

TEST(AcceptanceRestore, PutsBackAProgramThatWasKeyedIn) { CutEverywhere(0, 7); }

TEST(AcceptanceRestore, AnotherRunRestoresFirst) {
  const TemporaryFolder folder;
  const host::RestoreFile file(folder.path() / "acceptance.json");
  MemoryPlc cell(PlainMap(), Program(3));
  const hal::ProgramBlock found = cell.memory().Active().value();
  ASSERT_TRUE(RunAndCut(cell, file, 300));
  EXPECT_NE(cell.memory().Active().value(), found);
  cell.Mend();
  host::Plc plc(PlainMap(), cell.Carrier(), cell.clock());
  const auto result = host::RunAcceptance(plc, file, cell, {.bench = QuickBench()});
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_TRUE(result->passed()) << Broken(*result);
  EXPECT_EQ(result->found, found);
  EXPECT_EQ(cell.memory().Active().value(), found);
}

TEST(AcceptanceRestore, DoesNotBeginWhereItCannotWork) {
  const TemporaryFolder folder;
  const host::RestoreFile file(folder.path() / "acceptance.json");
  MemoryPlc cell(PlainMap(), Program(3));
  const auto why = [&] {
    host::Plc plc(PlainMap(), cell.Carrier(), cell.clock());
    const auto result = host::RunAcceptance(plc, file, cell, {.bench = QuickBench()});
    return result ? "" : result.error().message;
  };
  cell.Do(host::HandStep::kStartCycle);
  EXPECT_NE(why().find("bring the machine to set-up mode"), std::string::npos) << why();
  cell.Do(host::HandStep::kMakeIdle);
  cell.memory().SetActiveRowCount(0);
  EXPECT_NE(why().find("holds no program"), std::string::npos) << why();
  std::ofstream(file.path()) << "{}";
  EXPECT_NE(why().find("acceptance.json"), std::string::npos) << why();
  EXPECT_EQ(cell.writes(), 0u);
}

}  // namespace
}  // namespace bendloop::test
