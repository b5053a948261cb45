// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>

#include "firmware-host/history/history.h"
#include "live_cell.h"

// The cell's contract with the PLC through the whole daemon: a simulated bender with the block of
// config/register-maps/default.toml, three part files, and nobody at the panel.
namespace bendloop::testing {
namespace {

using hal::CellState;
using hal::TubeVerdict;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr std::uint32_t kDemo = 1001;
constexpr std::uint32_t kElbow = 1002;
constexpr std::uint32_t kOffset = 1003;

std::string PartText(std::uint32_t number, const std::string& rows) {
  return "schema = \"bendloop.part/1\"\nname = \"part " + std::to_string(number) +
         "\"\npart_number = " + std::to_string(number) +
         "\npipe_diameter_mm = 8\nbend_radius_mm = 20\n" + rows +
         "[tolerance]\nlength_mm = 1.0\n[material]\nspringback_at_20_deg = 1.2\n"
         "springback_at_120_deg = 3.6\n";
}

// What the PLC says anew; all else stays as it is.
template <class Change>
hal::PlcOrders With(Change change) {
  hal::PlcOrders said;
  change(said);
  return said;
}

class PlcCell : public LiveCell {
 public:
  explicit PlcCell(const std::string& more = "") : LiveCell(more, "", "parts_dir = \"parts\"\n") {
    profile_spacing_mm = 2;
    std::filesystem::create_directory(scratch() / "parts");
    Write("elbow",
          PartText(kElbow, "[[row]]\nlength_mm = 60\nangle_deg = 50\n[[row]]\nlength_mm = 90\n"));
    Write("offset", PartText(kOffset,
                             "[[row]]\nlength_mm = 50\nangle_deg = 70\n[[row]]\nlength_mm = 70\n"
                             "rotation_deg = 60\nangle_deg = 35\n[[row]]\nlength_mm = 100\n"));
    programs_[kDemo] = bender().Active();
    for (const char* name : {"elbow", "offset"}) {
      const auto part = config::LoadPart(PartFile(name));
      EXPECT_TRUE(part) << part.error().message;
      if (!part) continue;
      const auto first =
          pipeline::InitialProgram(*host::NominalProgram(*part), host::MaterialOf(*part));
      EXPECT_TRUE(first);
      programs_[part->part_number] = {part->part_number, 1, *first, 0};
    }
  }

  std::filesystem::path PartFile(const std::string& name) const {
    return scratch() / ("parts/" + name + ".toml");
  }
  void Write(const std::string& name, const std::string& text) const {
    std::ofstream(PartFile(name)) << text;
  }

  // The PLC changes over: the part's own program at the bender, as it was left, and its number.
  void SetPart(std::uint32_t number) {
    programs_[part_] = bender().Active();
    ASSERT_TRUE(bender().Load(programs_.at(number)));
    part_ = number;
    bender().Say(With([&](hal::PlcOrders& said) { said.part_number = number; }));
    ASSERT_TRUE(Told([&](const auto& cell) { return cell.part_set == number; })) << log();
  }

  Ran Ask(const std::string& what) const {
    return scratch().Bendloop(what + " --config " + cell_file());
  }

  template <class Condition>
  bool Told(Condition condition) {
    return Until([&] { return condition(bender().Heard()); });
  }

  // Scans a tube as `identity`; what the PLC is told of it.
  hal::CellReport ScanAs(const hal::BendProgram& tube, const std::string& identity) {
    bender().Say(With([&](hal::PlcOrders& said) {
      said.identity = identity;
      said.scan = hal::ScanOrder::kMayRun;
    }));
    const std::uint32_t before = bender().Heard().sequence;
    Trigger(tube);
    EXPECT_TRUE(Told([&](const auto& cell) { return cell.sequence != before; })) << log();
    EXPECT_GT(Results(), scans) << "told before it is on disk";
    bender().Say(With([&](hal::PlcOrders& said) {
      said.identity = "";
      said.scan = hal::ScanOrder::kOver;
    }));
    ++scans;
    return bender().Heard();
  }
  hal::CellReport Next(const std::string& identity) { return ScanAs(Bend(), identity); }

  std::uint32_t scans = 0;

 private:
  // Files of results, of this part number or another.
  std::size_t Results() const {
    std::size_t files = 0;
    for (const auto& file : std::filesystem::directory_iterator(scratch() / "state/results")) {
      files += file.path().extension() == ".json";
    }
    return files;
  }

  std::map<std::uint32_t, hal::ProgramBlock> programs_;
  std::uint32_t part_ = kDemo;
};

std::string Name(int tube) { return "COIL 7/T-" + std::to_string(1000 + tube); }

// Five tubes of a part.
void RunSome(PlcCell& cell, std::uint32_t part, int& tube) {
  cell.SetPart(part);
  for (int i = 0; i < 5; ++i) {
    const hal::CellReport told = cell.Next(Name(++tube));
    EXPECT_EQ(told.part_number, part);
    EXPECT_EQ(told.identity, Name(tube));
    EXPECT_NE(told.verdict, TubeVerdict::kNone);
    EXPECT_NE(told.verdict, TubeVerdict::kHeld) << cell.log();
  }
}

void HoldAndRelease(PlcCell& cell, int& tube) {
  const auto accepted = cell.bender().commits_accepted();
  cell.bender().Say(With([&](hal::PlcOrders& said) { said.hold = true; }));
  ASSERT_TRUE(cell.Told([](const auto& told) { return told.state == CellState::kHeld; }));
  for (int i = 0; i < 3; ++i) {
    EXPECT_NE(cell.Next(Name(++tube)).verdict, TubeVerdict::kHeld) << cell.log();
  }
  EXPECT_EQ(cell.bender().commits_accepted(), accepted);
  cell.bender().Say(With([&](hal::PlcOrders& said) { said.hold = false; }));
  ASSERT_TRUE(cell.Told([](const auto& told) { return told.state == CellState::kIdle; }))
      << cell.log();
}

// A number that no file has, and one that two have: held, told, recorded, and over with a good one.
void SetWrongParts(PlcCell& cell, int& tube, std::uint32_t part) {
  const std::string rows = "[[row]]\nlength_mm = 60\nangle_deg = 50\n[[row]]\nlength_mm = 90\n";
  cell.Write("twin", PartText(1004, rows));
  cell.Write("other-twin", PartText(1004, rows));
  for (const auto& [number, alarm] : {std::pair{9999u, 4010u}, std::pair{1004u, 4011u}}) {
    cell.bender().Say(With([number = number](hal::PlcOrders& said) { said.part_number = number; }));
    ASSERT_TRUE(cell.Told([alarm = alarm](const auto& told) {
      return told.alarm == alarm && told.state == CellState::kFault && told.part_set == 0;
    })) << cell.log();
    const hal::CellReport told = cell.Next(Name(++tube));
    EXPECT_EQ(told.verdict, TubeVerdict::kHeld);
    EXPECT_EQ(told.identity, Name(tube));
  }
  cell.SetPart(part);
  ASSERT_TRUE(cell.Told([](const auto& told) { return told.state == CellState::kIdle; }))
      << cell.log();
}

// The count of tubes jumps: the tube is held until the next one, or until somebody has seen it.
void AcknowledgeAJump(PlcCell& cell, int& tube) {
  const auto bent = cell.Bend();
  cell.Misbehave("set-count 4000");
  cell.ScanAs(bent, Name(++tube));
  ASSERT_TRUE(cell.Told([](const auto& told) { return told.alarm == 3006; })) << cell.log();
  cell.bender().Say(With([&](hal::PlcOrders& said) { said.acknowledge = 1; }));
  ASSERT_TRUE(cell.Told([](const auto& told) { return told.acknowledged == 1; })) << cell.log();
  ASSERT_TRUE(cell.Told([](const auto& told) { return told.alarm == 0; })) << cell.log();
  cell.bender().Say(With([&](hal::PlcOrders& said) { said.acknowledge = 0; }));
  ASSERT_TRUE(cell.Told([](const auto& told) { return told.acknowledged == 0; })) << cell.log();
}

// The PLC does not take what it is told: everything else goes on, and it is told later.
void RefuseTheReport(PlcCell& cell, int& tube) {
  cell.Misbehave("refuse-report");
  const auto bent = cell.Bend();
  cell.bender().Say(With([&](hal::PlcOrders& said) {
    said.identity = Name(++tube);
    said.scan = hal::ScanOrder::kMayRun;
  }));
  cell.Trigger(bent);
  EXPECT_TRUE(cell.Result(++cell.scans, ""));
  EXPECT_TRUE(cell.HasAlarm("BL4013")) << cell.log();
  cell.Misbehave("behave");
  EXPECT_TRUE(cell.Told([&](const auto& told) { return told.identity == Name(tube); }))
      << cell.log();
}

void BeginALot(PlcCell& cell) {
  cell.bender().Say(With([&](hal::PlcOrders& said) { said.new_lot = 7; }));
  ASSERT_TRUE(cell.Told([](const auto& told) { return told.lot_begun == 7; })) << cell.log();
  ASSERT_TRUE(cell.Becomes("/lot/number", 2)) << cell.log();
}

TEST(PlcCell, SixtyTubesUnattended) {
  PlcCell cell;
  cell.StartDaemon();
  int tube = 0;
  const std::uint16_t beat = static_cast<std::uint16_t>(cell.bender().Heard().heartbeat);
  for (int round = 0; round < 2; ++round) {
    for (const std::uint32_t part : {kElbow, kOffset, kDemo}) RunSome(cell, part, tube);
  }
  HoldAndRelease(cell, tube);
  cell.SetPart(kElbow);
  BeginALot(cell);
  RunSome(cell, kElbow, tube);
  SetWrongParts(cell, tube, kOffset);
  AcknowledgeAJump(cell, tube);
  RefuseTheReport(cell, tube);
  // The bender goes away, and comes back.
  cell.Misbehave("silent");
  EXPECT_TRUE(cell.HasAlarm("BL4001")) << cell.log();
  cell.Misbehave("behave");
  // The same tube once more: told as before, and counted once.
  RunSome(cell, kElbow, tube);
  const auto last = cell.Bend();
  cell.ScanAs(last, Name(++tube));
  const std::uint32_t tubes = cell.bender().Heard().tubes;
  cell.ScanAs(last, Name(tube));
  EXPECT_EQ(cell.bender().Heard().tubes, tubes);
  ASSERT_TRUE(cell.Becomes("/last_part/end", "repeat")) << cell.log();
  while (cell.scans < 60) RunSome(cell, cell.scans % 2 == 0 ? kElbow : kOffset, tube);

  EXPECT_GE(cell.scans, 60u);
  const hal::CellReport told = cell.bender().Heard();
  EXPECT_EQ(told.sequence, cell.scans);
  EXPECT_EQ(told.tubes, cell.scans - 1);
  EXPECT_EQ(told.passed + told.failed + told.undecided + told.held, told.tubes);
  EXPECT_GE(told.held, 2u);
  EXPECT_NE(told.heartbeat, beat);
  // Each part has a lot of its own, which setters reach by its number, beside a daemon and without.
  const Ran held = cell.Ask("lot hold --part-number 1002");
  EXPECT_EQ(held.code, 0) << held.err;
  EXPECT_EQ(cell.Ask("lot hold --part-number 9999").code, 3);
  cell.StopDaemon();
  EXPECT_THAT(cell.Ask("lot show --part-number 1002").out,
              AllOf(HasSubstr("part 1002: lot 2, "), HasSubstr("HELD")));
  const Ran released = cell.Ask("lot release --part-number 1002");
  EXPECT_EQ(released.code, 0) << released.err;
  for (const char* part : {"1002", "1003"}) {
    const Ran shown = cell.Ask("lot show --part-number " + std::string(part));
    EXPECT_THAT(shown.out, Not(HasSubstr("HELD"))) << shown.err;
  }
  // And the history knows all of them.
  for (const char* lot : {"lot.json", "lot-1002.json", "lot-1003.json"}) {
    EXPECT_TRUE(std::filesystem::exists(cell.scratch() / "state" / lot)) << lot;
  }
  const auto history = host::History::Open(cell.scratch() / "state/history.db");
  ASSERT_TRUE(history);
  const auto parts = history->Last(100);
  ASSERT_TRUE(parts);
  EXPECT_EQ(parts->size() + 2, cell.scans) << "two were held";
  EXPECT_EQ(parts->back().result.identity, Name(tube));
  const auto alarms = history->LastAlarms(1000);
  ASSERT_TRUE(alarms);
  std::map<int, int> ended;
  for (const host::Alarm& alarm : *alarms) {
    EXPECT_FALSE(alarm.is_active() &&
                 host::KindOf(alarm.code).severity == host::AlarmSeverity::kFault);
    ++ended[static_cast<int>(alarm.code)];
  }
  for (const int code : {3006, 4001, 4010, 4011, 4013, 4014, 4016}) EXPECT_GE(ended[code], 1);
}

// Nobody but the PLC is there: its acknowledgement lifts the lock that a broken rule left, and that
// of before the breach does not.
TEST(PlcCell, OnlyItsFreshAcknowledgementLiftsTheLockOfABrokenRule) {
  PlcCell cell;
  cell.bender().Say(With([](hal::PlcOrders& said) { said.acknowledge = 5; }));
  cell.StartDaemon();
  cell.Misbehave("break rejects-and-activates");
  cell.Next("T-1");
  ASSERT_TRUE(cell.Told([](const auto& told) { return told.alarm == 4002; })) << cell.log();
  EXPECT_EQ(cell.bender().commits_accepted(), 1u);
  cell.Misbehave("behave");
  const auto off = [&] {
    hal::BendProgram tube = cell.Bend();
    for (hal::BendRow& row : tube.rows) row.angle_deg -= row.angle_deg > 0 ? 0.8 : 0;
    return tube;
  };
  cell.ScanAs(off(), "T-2");
  const auto locked = cell.Result(2, "refused");
  ASSERT_TRUE(locked && locked->bender);
  EXPECT_THAT(locked->bender->reason, ::testing::HasSubstr("corrections are locked"));
  EXPECT_EQ(cell.bender().commits_accepted(), 1u);
  cell.bender().Say(With([](hal::PlcOrders& said) { said.acknowledge = 6; }));
  ASSERT_TRUE(cell.Told([](const auto& told) { return told.acknowledged == 6; })) << cell.log();
  ASSERT_TRUE(cell.Told([](const auto& told) { return told.alarm == 0; })) << cell.log();
  cell.ScanAs(off(), "T-3");
  EXPECT_TRUE(cell.Result(3, "committed")) << cell.log();
  EXPECT_EQ(cell.bender().commits_accepted(), 2u);
}

// A scanner that says neither where a scan begins nor where it ends, and minutes until its silence
// would: the PLC's word ends it.
TEST(PlcCell, ItsWordEndsAScanThatRuns) {
  PlcCell cell("[scan]\nend = \"coverage\"\nsilence_seconds = 300\nmax_seconds = 600\n");
  cell.StartDaemon();
  const auto say = [&](hal::ScanOrder order) {
    cell.bender().Say(With([&](hal::PlcOrders& said) { said.scan = order; }));
  };
  const auto bent = cell.Bend();
  say(hal::ScanOrder::kMayRun);
  cell.Sweep(bent, 0.3);  // less than shows the whole tube
  ASSERT_TRUE(cell.Told([](const auto& told) { return told.state == CellState::kScanning; }))
      << cell.log();
  EXPECT_EQ(cell.results(), 0u);
  say(hal::ScanOrder::kOver);
  ASSERT_TRUE(cell.Told([](const auto& told) { return told.sequence == 1; })) << cell.log();
  EXPECT_EQ(cell.bender().Heard().verdict, TubeVerdict::kHeld);
  EXPECT_EQ(cell.bender().commits_accepted(), 0u);
}

}  // namespace
}  // namespace bendloop::testing
