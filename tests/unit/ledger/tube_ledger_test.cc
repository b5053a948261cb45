// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/ledger/tube_ledger.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "firmware-host/ledger/moment.h"

namespace bendloop::host {
namespace {

using pipeline::InterlockKind;
using ::testing::HasSubstr;

constexpr std::int64_t kLookNs = 250'000'000;

// A bender as the ledger sees it, a look every quarter of a second.
class TubeLedgerTest : public ::testing::Test {
 protected:
  TubeLedgerTest() { Reopen({}); }
  ~TubeLedgerTest() override { std::filesystem::remove_all(folder_); }

  void Reopen(const LedgerRules& rules) {
    ledger_.reset();
    auto opened = TubeLedger::Open(folder_ / "journal.db", rules);
    ASSERT_TRUE(opened) << opened.error().message;
    ledger_.emplace(std::move(*opened));
  }
  static hal::ProgramBlock Program(std::uint32_t part, std::uint32_t sequence, double angle_deg) {
    return {part, sequence, {{{100, 0, angle_deg, 30.0}, {50, 0, 0, std::nullopt}}}, sequence + 7};
  }

  void Look(std::int64_t later_ns = kLookNs) {
    now_ns_ += later_ns;
    Sighting seen{now_ns_, now_ns_, state_, active_};
    seen.state.active_part_number = active_.part_number;
    seen.state.active_sequence = active_.sequence;
    ASSERT_TRUE(ledger_->Observe(seen, [this](const auto& from, const auto& to) {
      return from == ours_.first && to == ours_.second;
    }));
  }
  void Bend(std::uint32_t tubes = 1) {
    state_.parts_bent += tubes;
    Look();
  }
  void CommitOurs(const hal::ProgramBlock& next) {
    ours_ = {active_, next};
    active_ = next;
    Look();
  }
  TubeMatch Scan(const std::string& session, const std::optional<TubeName>& name = {}) {
    now_ns_ += 1'000'000;
    const std::int64_t began_ns = now_ns_;
    Look();
    return ledger_->Match({session, began_ns, name});
  }
  static const pipeline::TubeCheck* Failed(const TubeMatch& match) {
    for (const auto& check : match.checks) {
      if (!check.passed) return &check;
    }
    return nullptr;
  }
  static void ExpectHeld(const TubeMatch& match, InterlockKind kind, const char* words) {
    const auto* const failed = Failed(match);
    ASSERT_NE(failed, nullptr);
    EXPECT_EQ(failed->kind, kind);
    EXPECT_THAT(failed->found, HasSubstr(words));
    EXPECT_FALSE(failed->mend.empty());
  }

  std::filesystem::path folder_ = [] {
    std::string name = (std::filesystem::temp_directory_path() / "bendloop-XXXXXX").string();
    return std::filesystem::path(mkdtemp(name.data()));
  }();
  std::optional<TubeLedger> ledger_;
  std::int64_t now_ns_ = 1'000'000'000'000;
  hal::BenderState state_{.mode = hal::BenderMode::kIdle};
  hal::ProgramBlock active_ = Program(77, 1, 90);
  std::pair<hal::ProgramBlock, hal::ProgramBlock> ours_;
};

TEST_F(TubeLedgerTest, AScanFindsItsTubeAndUsesItUp) {
  Look();
  Look();
  Bend();
  const TubeMatch match = Scan("part-0001");
  EXPECT_TRUE(match.passed());
  EXPECT_EQ(match.bent_with, active_);
  EXPECT_EQ(match.expected, active_);
  ASSERT_TRUE(ledger_->Use("part-0001", match));
  EXPECT_TRUE(ledger_->Use("part-0001", match));  // after a wait
  EXPECT_FALSE(ledger_->Use("part-0002", match));
  const TubeMatch again = Scan("part-0002");
  ExpectHeld(again, InterlockKind::kNewTube, "part-0001");
  EXPECT_EQ(again.repeats, "part-0001");
}

TEST_F(TubeLedgerTest, AnEditInTheMiddleOfACycleIsNotWhatBentItsTube) {
  Look();
  Look();
  const auto bent = active_;
  state_.mode = hal::BenderMode::kBending;
  Look();
  active_ = Program(77, 0, 96);
  Look();
  state_.mode = hal::BenderMode::kIdle;
  Bend();
  EXPECT_EQ(Scan("part-0001").bent_with, bent);
  // The same where the cycle was not seen to begin.
  state_.mode = hal::BenderMode::kBending;
  active_ = Program(77, 0, 94);
  Look();
  Look();
  state_.mode = hal::BenderMode::kIdle;
  Bend();
  EXPECT_FALSE(ledger_->tubes().back().program);
  Bend();
  EXPECT_EQ(ledger_->tubes().back().program, active_);
}

TEST_F(TubeLedgerTest, ATubeCountedJustWhenTheScanBeganMayBeTheLastOneAgain) {
  Look();
  Look();
  Bend();
  const TubeMatch match = Scan("part-0001");
  ASSERT_TRUE(ledger_->Use("part-0001", match));
  const std::int64_t began_ns = now_ns_ + 1'000'000;
  Bend();
  ExpectHeld(ledger_->Match({"part-0002", began_ns}), InterlockKind::kNewTube,
             "just when the scan began");
  EXPECT_TRUE(Scan("part-0003").passed());
}

TEST_F(TubeLedgerTest, AFirstLookKnowsNoTube) {
  state_.parts_bent = 41;
  Look();
  ExpectHeld(Scan("part-0001"), InterlockKind::kNewTube, "no new tube");
}

TEST_F(TubeLedgerTest, ABenderThatNeverAnsweredIsSaidSo) {
  ExpectHeld(ledger_->Match({"part-0001", 5}), InterlockKind::kTubeCount, "not told");
}

TEST_F(TubeLedgerTest, ARestartForgetsNothing) {
  Look();
  Look();
  Bend();
  Reopen({});
  Look();
  const TubeMatch match = Scan("part-0001");
  EXPECT_TRUE(match.passed());
  ASSERT_TRUE(ledger_->Use("part-0001", match));
  Reopen({});
  Look();
  ExpectHeld(Scan("part-0002"), InterlockKind::kNewTube, "part-0001");
}

TEST_F(TubeLedgerTest, ATubeBentWhileNobodyLookedHasNoProgram) {
  Look();
  Reopen({});
  Bend();
  ExpectHeld(Scan("part-0001"), InterlockKind::kTubeProgram, "could not be followed");
}

TEST_F(TubeLedgerTest, ATubeBentWhileTheLinkWasDownHasNoProgram) {
  Look();
  state_.parts_bent += 1;
  Look(6'000'000'000);
  ExpectHeld(Scan("part-0001"), InterlockKind::kTubeProgram, "could not be followed");
}

TEST_F(TubeLedgerTest, ACountThatJumpsHoldsTheScanAndTheNextTubeIsGoodAgain) {
  Look();
  Look();
  Bend();
  Bend(40);
  ExpectHeld(Scan("part-0001"), InterlockKind::kTubeCount, "jumped from 1 to 41");
  Reopen({});
  Look();
  ExpectHeld(Scan("part-0001"), InterlockKind::kTubeCount, "jumped from 1 to 41");
  Bend();
  const TubeMatch match = Scan("part-0002");
  EXPECT_EQ(match.bent_with, active_);
}

TEST_F(TubeLedgerTest, ACountSetBackJumps) {
  state_.parts_bent = 500;
  Look();
  state_.parts_bent = 1;
  Look();
  ExpectHeld(Scan("part-0001"), InterlockKind::kTubeCount, "jumped from 500 to 1");
}

TEST_F(TubeLedgerTest, ANarrowCounterGoesRound) {
  Reopen({.counted = true, .parts_between = 0, .count_modulus = 65536});
  state_.parts_bent = 65535;
  Look();
  Look();
  state_.parts_bent = 0;
  Look();
  EXPECT_TRUE(Scan("part-0001").passed());
}

TEST_F(TubeLedgerTest, AProgramThatChangedWithTheCountLeavesTheTubeWithoutOne) {
  Look();
  active_ = Program(77, 0, 96);
  Bend();
  ExpectHeld(Scan("part-0001"), InterlockKind::kTubeProgram, "changed about when");
}

TEST_F(TubeLedgerTest, ACycleSeenRunningKeepsItsProgram) {
  Look();
  Look();
  const auto bent = active_;
  state_.mode = hal::BenderMode::kBending;
  Look();
  active_ = Program(77, 0, 96);
  state_.mode = hal::BenderMode::kIdle;
  Bend();
  const TubeMatch match = Scan("part-0001");
  EXPECT_EQ(match.bent_with, bent);
  EXPECT_EQ(match.expected, bent);  // and not what is active: the edit was not ours
}

TEST_F(TubeLedgerTest, AnEditAfterTheBendIsNotWhatIsExpected) {
  Look();
  Look();
  Bend();
  const auto bent = active_;
  active_.program.rows[0].angle_deg += 6;
  Look();
  const TubeMatch match = Scan("part-0001");
  EXPECT_EQ(match.bent_with, bent);
  EXPECT_EQ(match.expected, bent);
}

TEST_F(TubeLedgerTest, OurOwnCorrectionsInBetweenAreExpected) {
  Reopen({.counted = true, .parts_between = 1, .count_modulus = std::uint64_t{1} << 32});
  Look();
  Look();
  const auto first = active_;
  Bend();
  Bend();
  const TubeMatch one = Scan("part-0001");
  EXPECT_EQ(one.bent_with, first);
  ASSERT_TRUE(ledger_->Use("part-0001", one));
  CommitOurs(Program(77, 2, 91));
  Bend();
  const TubeMatch two = Scan("part-0002");
  EXPECT_TRUE(two.passed());
  EXPECT_EQ(two.bent_with, first);
  EXPECT_EQ(two.expected, active_);
  ASSERT_TRUE(ledger_->Use("part-0002", two));
  Bend();
  EXPECT_EQ(Scan("part-0003").bent_with, active_);
}

TEST_F(TubeLedgerTest, TheSameTubeAgainWithOthersWaiting) {
  Reopen({.counted = true, .parts_between = 2, .count_modulus = std::uint64_t{1} << 32});
  Look();
  Look();
  Bend(3);
  const TubeMatch match = Scan("part-0001");
  ASSERT_TRUE(match.passed());
  ASSERT_TRUE(ledger_->Use("part-0001", match));
  ExpectHeld(Scan("part-0002"), InterlockKind::kNewTube, "2 that lie between");
}

TEST_F(TubeLedgerTest, AutoTakesAsManyAsLayBetweenAtTheFirstScan) {
  Reopen({.counted = true, .parts_between = {}, .count_modulus = std::uint64_t{1} << 32});
  Look();
  Look();
  Bend(3);
  const TubeMatch first = Scan("part-0001");
  ASSERT_TRUE(first.passed());
  ASSERT_TRUE(ledger_->Use("part-0001", first));
  ExpectHeld(Scan("part-0002"), InterlockKind::kNewTube, "2 that lie between");
  Bend();
  EXPECT_EQ(Scan("part-0003").tube, *first.tube + 1);
}

TEST_F(TubeLedgerTest, TubesLeftOutAreMissedOnlyWhereTheirProgramsDiffer) {
  Look();
  Look();
  Bend();
  Bend();
  EXPECT_TRUE(Scan("part-0001").passed());
  active_ = Program(77, 0, 96);
  Look();
  Look();
  Bend();
  const TubeMatch match = Scan("part-0002");
  ExpectHeld(match, InterlockKind::kTubeProgram, "not certain");
  ASSERT_TRUE(ledger_->PassOver("part-0002", match));
  Bend();
  EXPECT_TRUE(Scan("part-0003").passed());
}

TEST_F(TubeLedgerTest, ATubeWithAnotherNameIsHeldAndUsesNothingUp) {
  Look();
  Look();
  Bend();
  const TubeName a16{77, "A16"};
  const TubeMatch first = Scan("part-0001", a16);
  ASSERT_TRUE(ledger_->Use("part-0001", first, a16));
  const TubeName a17{77, "A17"};
  const TubeMatch stranger = Scan("part-0002", a17);
  EXPECT_EQ(stranger.checks.back().kind, InterlockKind::kTubeIdentity);
  EXPECT_THAT(stranger.checks.back().found, HasSubstr("'A17', expected 'A16'"));
  EXPECT_FALSE(stranger.passed());
  EXPECT_FALSE(stranger.repeats);
  ASSERT_TRUE(ledger_->PassOver("part-0002", stranger, a17));
  Bend();
  EXPECT_TRUE(Scan("part-0003", a17).passed());
}

// Whatever the count says, and over a restart: the database knows.
TEST_F(TubeLedgerTest, ANameThatWasUsedUpIsThatTubeOnceMore) {
  Look();
  Look();
  Bend();
  const TubeName name{77, "COIL 7/T-1"};
  const TubeMatch first = Scan("part-0001", name);
  EXPECT_TRUE(first.passed());
  ASSERT_TRUE(ledger_->Use("part-0001", first, name));
  // The same scan, after a wait for the bender.
  EXPECT_TRUE(Scan("part-0001", name).passed());

  Reopen({});
  Look();
  Look();
  Bend();
  const TubeMatch again = Scan("part-0002", name);
  ExpectHeld(again, InterlockKind::kNewTube, "'COIL 7/T-1', which was scanned as part-0001");
  EXPECT_EQ(again.repeats, "part-0001");
  EXPECT_FALSE(again.tube);
  // Another part's tube may have the same name, and the one that was bent waits still.
  EXPECT_TRUE(Scan("part-0002", TubeName{78, "COIL 7/T-1"}).passed());
}

TEST_F(TubeLedgerTest, ATubeThatIsPassedOverKeepsItsName) {
  Look();
  Look();
  active_ = Program(77, 0, 96);
  Bend();
  const TubeName name{77, "T-1"};
  const TubeMatch doubtful = Scan("part-0001", name);
  ExpectHeld(doubtful, InterlockKind::kTubeProgram, "the program was changed");
  ASSERT_TRUE(ledger_->PassOver("part-0001", doubtful, name));
  Look();
  Bend();
  ExpectHeld(Scan("part-0002", name), InterlockKind::kNewTube, "scanned as part-0001");
}

TEST_F(TubeLedgerTest, TheLastTubesOfABatchAreNotTakenForTheLastOneAgain) {
  Reopen({.counted = true, .parts_between = 1, .count_modulus = std::uint64_t{1} << 32});
  Look();
  Look();
  Bend(2);
  const TubeMatch match = Scan("part-0001");
  ASSERT_TRUE(ledger_->Use("part-0001", match));
  const TubeMatch last = Scan("part-0002");
  ExpectHeld(last, InterlockKind::kNewTube, "(tube 1 of the bender's count, part-0001) or one of");
  EXPECT_FALSE(last.repeats);
  EXPECT_FALSE(last.tube);  // and it stays for the next batch's first bend
  Bend();
  EXPECT_EQ(Scan("part-0003").tube, *match.tube + 1);
}

TEST_F(TubeLedgerTest, WithoutACountEachScanIsANewTubeOfTheProgramAtItsStart) {
  Reopen({.counted = false, .parts_between = 0, .count_modulus = 1});
  Look();
  const auto bent = active_;
  const TubeMatch match = Scan("part-0001");
  EXPECT_TRUE(match.passed());
  EXPECT_EQ(match.bent_with, bent);
  const std::int64_t began_ns = now_ns_;
  active_ = Program(77, 0, 96);
  Look();
  const TubeMatch edited = ledger_->Match({"part-0002", began_ns});
  EXPECT_EQ(edited.bent_with, bent);
  EXPECT_EQ(edited.expected, bent);  // the bender holds another one: nothing is sent
}

TEST_F(TubeLedgerTest, FatesAreKept) {
  ASSERT_TRUE(ledger_->Note("part-0001", ScanFate::kWaiting, "bending"));
  ASSERT_TRUE(ledger_->Note("part-0002", ScanFate::kWaiting, ""));
  ASSERT_TRUE(ledger_->Note("part-0002", ScanFate::kDone, ""));
  Reopen({});
  EXPECT_THAT(ledger_->Sessions(ScanFate::kWaiting).value(), ::testing::ElementsAre("part-0001"));
}

TEST(Moment, TheLongerOfTwoClocksCounts) {
  EXPECT_DOUBLE_EQ(SecondsBetween({0, 0}, {5'000'000'000, 4000}), 5);
  EXPECT_DOUBLE_EQ(SecondsBetween({0, 0}, {5'000'000'000, 3'600'000}), 3600);
  EXPECT_DOUBLE_EQ(SecondsBetween({0, 9'000'000}, {5'000'000'000, 0}), 5);  // set back
  const Moment now = SystemMoment();
  EXPECT_GE(SecondsBetween(now, SystemMoment()), 0);
}

}  // namespace
}  // namespace bendloop::host
