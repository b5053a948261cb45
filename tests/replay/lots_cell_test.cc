// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "firmware-host/history/history.h"
#include "live_cell.h"

// The troubles of a bender through the whole daemon: a simulated bender over Modbus TCP whose tubes
// are spoilt further, scanned by a simulated scanner over its wire.
namespace bendloop::testing {
namespace {

using ::testing::HasSubstr;

class LotCell : public LiveCell {
 public:
  using LiveCell::LiveCell;

  // Bends and scans the next tube, all of its angles off by so much besides; as it truly is.
  hal::BendProgram Next(double off_deg = 0) {
    hal::BendProgram tube = Bend();
    for (std::size_t i = 0; i < tube.bend_count(); ++i) tube.rows[i].angle_deg += off_deg;
    last = Scan(tube, ++number_, "");
    return tube;
  }
  double Worst(const hal::BendProgram& tube) const {
    double worst = 0;
    for (std::size_t i = 0; i < tube.bend_count(); ++i) {
      worst = std::max(worst, std::abs(tube.rows[i].angle_deg - plan().nominal.rows[i].angle_deg));
    }
    return worst;
  }
  double Mean(const hal::BendProgram& tube) const {
    double sum = 0;
    for (std::size_t i = 0; i < tube.bend_count(); ++i) {
      sum += tube.rows[i].angle_deg - plan().nominal.rows[i].angle_deg;
    }
    return sum / static_cast<double>(tube.bend_count());
  }
  Ran Ask(const std::string& what) const {
    return scratch().Bendloop(what + " --config " + cell_file());
  }
  std::string RequestsLog() const { return Slurp(scratch() / "state/requests.log"); }
  const std::vector<std::string>& notices() const { return last->correction->notices; }

  std::optional<host::RunResult> last;

 private:
  unsigned number_ = 0;
};

TEST(LotsCell, ACoilThatChangesUnannouncedIsFollowedAfterTheSecondPart) {
  LotCell cell;
  cell.profile_spacing_mm = 2;
  cell.StartDaemon();
  for (int part = 0; part < 4; ++part) cell.Next();
  const double before = cell.Worst(cell.Next());
  EXPECT_LT(before, 0.1);
  cell.Next(-0.8);
  EXPECT_THAT(cell.notices(), ::testing::Contains(HasSubstr("may have slipped")));
  cell.Next(-0.8);
  EXPECT_THAT(cell.notices(), ::testing::Contains(HasSubstr("jump")));
  EXPECT_LT(cell.Worst(cell.Next(-0.8)), 0.2);
  EXPECT_LT(cell.Worst(cell.Next(-0.8)), 0.2);
  // What the correction has to say reaches everybody.
  EXPECT_THAT(cell.log(), HasSubstr("correction: jump"));
  const auto history = host::History::Open(cell.scratch() / "state/history.db");
  ASSERT_TRUE(history);
  const auto parts = history->Last(3);
  ASSERT_TRUE(parts && parts->front().result.correction);
  EXPECT_THAT(parts->front().result.correction->notices, ::testing::Contains(HasSubstr("jump")));
}

TEST(LotsCell, ADriftLeavesNoBias) {
  LotCell cell;
  cell.profile_spacing_mm = 2;
  cell.StartDaemon();
  double bias = 0;
  constexpr int kParts = 18;
  for (int part = 0; part < kParts; ++part) {
    const double mean = cell.Mean(cell.Next(-0.02 * part));
    if (part >= kParts - 6) bias += mean / 6;
  }
  EXPECT_LT(std::abs(bias), 0.05);
}

TEST(LotsCell, ASlippedTubeMovesNothing) {
  LotCell cell;
  cell.profile_spacing_mm = 2;
  cell.StartDaemon();
  for (int part = 0; part < 4; ++part) cell.Next();
  const double before = cell.Mean(cell.bender().Active().program);
  cell.Next(-1.5);
  EXPECT_THAT(cell.notices(), ::testing::Contains(HasSubstr("may have slipped")));
  EXPECT_NEAR(cell.Mean(cell.bender().Active().program), before, 0.1);
  cell.Next();
  EXPECT_THAT(cell.notices(), ::testing::Contains(HasSubstr("slipped")));
  EXPECT_NEAR(cell.Mean(cell.bender().Active().program), before, 0.1);
}

// Laser lines so far apart that nobody knows to a twentieth of a millimetre where the tube ends.
TEST(LotsCell, AnEndThatIsNotKnownHoldsNoOtherRow) {
  LotCell cell("[interlocks]\nmax_sigma_length_mm = 0.05\n");
  cell.profile_spacing_mm = 2;
  cell.StartDaemon();
  EXPECT_GT(cell.Worst(cell.Next()), 0.5);
  ASSERT_TRUE(cell.last->bender);
  EXPECT_EQ(cell.last->bender->outcome, host::CommitOutcome::kCommitted)
      << cell.last->bender->reason;
  ASSERT_TRUE(cell.last->correction);
  EXPECT_THAT(cell.notices(), ::testing::Contains(HasSubstr("end length is known to")));
  EXPECT_NE(cell.last->correction->rows.back().length_mm.flags & pipeline::kFlagUncertain, 0u);
  EXPECT_LT(cell.Worst(cell.Next()), 0.2);
}

TEST(LotsCell, TheForecastAndTheVerdictsProbabilityStandInResultAndStatus) {
  LotCell cell;
  cell.profile_spacing_mm = 2;
  cell.StartDaemon();
  cell.Next();
  cell.Next();
  const pipeline::Forecast& forecast = cell.last->correction->forecast;
  ASSERT_EQ(forecast.rows.size(), cell.plan().nominal.rows.size());
  EXPECT_GT(forecast.part, 0.5);
  EXPECT_LT(forecast.part, 1);
  EXPECT_GE(cell.last->inspection->probability, 0);
  EXPECT_LE(cell.last->inspection->probability, 1);
  EXPECT_TRUE(LiveCell::Until([&] {
    const auto status = host::FetchStatus(cell.scratch() / "state/status.json");
    return status && status->contains("last_part") &&
           (*status)["last_part"]["session"] == "part-0002" &&
           (*status)["last_part"]["forecast"].is_number() && (*status)["lot"]["parts"] == 2;
  }));
}

TEST(LotsCell, AHeldLotSendsNothingUntilItIsReleased) {
  LotCell cell;
  cell.profile_spacing_mm = 2;
  cell.StartDaemon();
  const Ran held = cell.Ask("lot hold");
  EXPECT_EQ(held.code, 0) << held.err;
  cell.Next();
  EXPECT_EQ(cell.bender().commits_accepted(), 0u);
  EXPECT_THAT(cell.notices(), ::testing::Contains(HasSubstr("the lot is held")));
  EXPECT_TRUE(cell.Becomes("/lot/held", true));
  EXPECT_EQ(cell.Ask("lot release").code, 0);
  cell.Next();
  EXPECT_EQ(cell.bender().commits_accepted(), 1u);
  EXPECT_THAT(cell.RequestsLog(), HasSubstr("\"request\":\"lot hold\""));
  EXPECT_THAT(cell.RequestsLog(), HasSubstr("\"who\":\""));
}

// Somebody at the machine is not kept waiting by a bender that bends: what a correction that waits
// does not touch is granted, and it is given up for the rest.
TEST(LotsCell, ACorrectionThatWaitsKeepsNobodyWaiting) {
  LotCell cell;
  cell.profile_spacing_mm = 2;
  cell.StartDaemon();
  const auto tube = cell.Bend();
  cell.Misbehave("mode bending");
  cell.Scan(tube, 1, "waiting");
  const Ran seen = cell.Ask("acknowledge");
  EXPECT_EQ(seen.code, 0) << seen.err;
  EXPECT_TRUE(cell.Becomes("/last_part/end", "waiting"));
  const Ran held = cell.Ask("lot hold");
  EXPECT_EQ(held.code, 0) << held.err;
  const auto given_up = cell.Result(1, "refused");
  ASSERT_TRUE(given_up && given_up->bender);
  EXPECT_THAT(given_up->bender->reason, HasSubstr("asked for 'lot hold'"));
  EXPECT_TRUE(cell.Becomes("/lot/held", true));
  cell.Misbehave("mode idle");
  cell.AwaitALook();
  EXPECT_EQ(cell.bender().commits_accepted(), 0u);
}

TEST(LotsCell, UndoBringsBackTheProgramBeforeAndHoldsTheLot) {
  LotCell cell;
  cell.profile_spacing_mm = 2;
  cell.StartDaemon();
  const Ran nothing = cell.Ask("undo");
  EXPECT_EQ(nothing.code, 1);
  EXPECT_THAT(nothing.err, HasSubstr("nothing to undo"));
  const hal::ProgramBlock first = cell.bender().Active();
  cell.Next();
  ASSERT_NE(cell.bender().Active().program, first.program);
  const Ran undone = cell.Ask("undo");
  EXPECT_EQ(undone.code, 0) << undone.err;
  EXPECT_EQ(cell.bender().Active().program, first.program);
  EXPECT_TRUE(cell.Becomes("/lot/held", true));
  cell.Misbehave("edit 3");
  EXPECT_EQ(cell.Ask("undo").code, 1);
}

TEST(LotsCell, TheFirstProgramIsSentByTheSameProtocol) {
  LotCell cell;
  cell.profile_spacing_mm = 2;
  cell.StartDaemon();
  const hal::ProgramBlock first = cell.bender().Active();
  cell.Next();
  ASSERT_NE(cell.bender().Active().program, first.program);
  const Ran sent = cell.Ask("first-program --send");
  EXPECT_EQ(sent.code, 0) << sent.err;
  EXPECT_EQ(cell.bender().Active().program, first.program);
  EXPECT_TRUE(cell.Becomes("/lot/number", 2));
}

// A bender that says no and does it: told, locked over a restart, and sent to again when somebody
// has acknowledged.
TEST(LotsCell, ABenderThatBreaksARuleGetsNothingUntilItIsAcknowledged) {
  LotCell cell;
  cell.profile_spacing_mm = 2;
  cell.StartDaemon();
  cell.Misbehave("break rejects-and-activates");
  cell.Next();
  ASSERT_TRUE(cell.last && cell.last->bender);
  EXPECT_EQ(cell.last->bender->outcome, host::CommitOutcome::kCommitted) << "it is what it bends";
  EXPECT_THAT(cell.last->bender->breach, HasSubstr("R15: it rejected the program"));
  cell.Misbehave("behave");
  cell.StopDaemon();
  cell.StartDaemon();
  EXPECT_TRUE(LiveCell::Until([&] {
    const auto status = host::FetchStatus(cell.scratch() / "state/status.json");
    return status && status->dump().find("BL4002") != std::string::npos;
  }));
  cell.Next();
  EXPECT_EQ(cell.bender().commits_accepted(), 1u);
  EXPECT_THAT(cell.last->bender->reason, HasSubstr("corrections are locked"));
  const Ran seen = cell.Ask("acknowledge");
  EXPECT_EQ(seen.code, 0) << seen.err;
  EXPECT_THAT(seen.out, HasSubstr("R15"));
  cell.Next(-0.8);
  EXPECT_EQ(cell.bender().commits_accepted(), 2u) << cell.last->bender->reason;
}

TEST(LotsCell, WithoutADaemonRequestsAreGrantedAtOnce) {
  LotCell cell;
  cell.profile_spacing_mm = 2;
  cell.StartDaemon();
  const hal::ProgramBlock first = cell.bender().Active();
  cell.Next();
  cell.StopDaemon();
  EXPECT_EQ(cell.Ask("undo").code, 0);
  EXPECT_EQ(cell.bender().Active().program, first.program);
  const Ran shown = cell.Ask("lot show");
  EXPECT_EQ(shown.code, 0) << shown.err;
  EXPECT_THAT(shown.out, HasSubstr("lot 1, 1 part, HELD"));
  EXPECT_EQ(cell.Ask("lot new").code, 0);
  EXPECT_THAT(cell.Ask("lot show --json").out, HasSubstr("\"number\": 2"));
}

TEST(LotsCell, RemovingTheLotUnderTheDaemonBeginsANewOne) {
  LotCell cell;
  cell.profile_spacing_mm = 2;
  cell.StartDaemon();
  cell.Next();
  EXPECT_TRUE(cell.Becomes("/lot/parts", 1));
  std::filesystem::remove(cell.scratch() / "state/lot.json");
  cell.Next();
  EXPECT_TRUE(cell.Becomes("/last_part/session", "part-0002"));
  EXPECT_TRUE(cell.Becomes("/lot/parts", 1));
  EXPECT_THAT(cell.log(), HasSubstr("lot.json was removed"));
}

}  // namespace
}  // namespace bendloop::testing
