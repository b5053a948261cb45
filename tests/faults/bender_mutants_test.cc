// SPDX-License-Identifier: Apache-2.0
//
// A bender that breaks a rule: what is said of it is true and stays true, what is proven locks the
// corrections until somebody acknowledges, and what it bends at the end is the old program or the
// new.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <map>
#include <set>
#include <string>

#include "drivers/simulated_bender/rule_mutant.h"
#include "firmware-host/commit/commit_protocol.h"
#include "tests/support/canopen_bender_under_test.h"
#include "tests/support/faulty_link.h"
#include "tests/support/isotp_bender_under_test.h"
#include "tests/support/memory_bender.h"
#include "tests/support/modbus_bender_under_test.h"

namespace bendloop::test {
namespace {

using drivers::RuleMutant;
using host::CommitJournal;
using host::CommitOutcome;
using host::CommitProtocol;
using host::CommitReport;
using testing::HasSubstr;
using testing::StartsWith;
using M = RuleMutant;

// Rules that one commit proves broken, by what one has seen of it.
const std::map<RuleMutant, const char*> kProven{
    {M::kCopiesNothing, "R13: it accepted the program and kept the old one"},
    {M::kCopiesAllButLastRow, "R13: it accepted the program, but"},
    {M::kCopiesRowWrong, "R13: it accepted the program, but"},
    {M::kCopiesRowWrongKeepsCrc, "R13: it accepted the program, but"},
    {M::kCopiesOldSequence, "R13: it accepted the program, but"},
    {M::kAnswersBeforeCopying, "R13: it accepted the program before"},
    {M::kRejectsAndActivates, "R15: it rejected the program, reply code 4"},
    {M::kActivatesOnStaging, "R4: it made the staged program active"},
};

class BenderMutants : public testing::Test {
 protected:
  BenderMutants() : journal_(CommitJournal::Open(":memory:").value()) {}

  void Start(std::initializer_list<RuleMutant> broken) {
    bender_.emplace(PlainMap(), hal::ProgramBlock{42, 3, RandomProgram(random_, 4), 0});
    journal_ = CommitJournal::Open(":memory:").value();
    drivers::RuleMutantSet set;
    for (const RuleMutant mutant : broken) set.Add(mutant);
    bender_->memory().Break(set);
    link_.emplace(*bender_, Fault{});
    link_->before_call = [this](int) { bender_->Pass(clock_.Now()); };
    base_ = bender_->Active();
    program_ = RandomProgram(random_, 4);
  }
  CommitReport Commit(const std::string& session = "scan") {
    return CommitProtocol(*link_, journal_, clock_).Commit({session, bender_->Active(), program_});
  }
  void Wait(std::chrono::seconds time) {
    clock_.Advance(time);
    bender_->Pass(clock_.Now());
  }
  bool HoldsSent() const {
    const auto attempt = journal_.Last().value();
    return attempt && bender_->Active() == attempt->next;
  }
  std::string OpenBreach() const { return journal_.OpenBreach().value().value_or(""); }

  std::mt19937_64 random_{21};
  hal::ManualClock clock_;
  std::optional<MemoryBender> bender_;
  std::optional<FaultyLink> link_;
  CommitJournal journal_;
  hal::ProgramBlock base_;
  hal::BendProgram program_;
};

TEST_F(BenderMutants, WhatIsSaidOfEachIsTrueAndStaysTrue) {
  std::set<RuleMutant> proven;
  for (const drivers::RuleMutantFacts& facts : drivers::RuleMutants()) {
    SCOPED_TRACE(std::string(facts.name));
    Start({facts.mutant});
    const CommitReport report = Commit();
    SCOPED_TRACE(report.reason);
    Wait(std::chrono::seconds(10));
    EXPECT_EQ(report.outcome == CommitOutcome::kCommitted, HoldsSent());
    EXPECT_NE(report.outcome, CommitOutcome::kUnknown);
    EXPECT_FALSE(journal_.Unfinished().value());
    if (!report.breach.empty()) {
      proven.insert(facts.mutant);
      ASSERT_TRUE(kProven.contains(facts.mutant));
      EXPECT_THAT(report.breach, StartsWith(kProven.at(facts.mutant)));
      EXPECT_THAT(report.reason, HasSubstr(report.breach));
      EXPECT_EQ(OpenBreach(), report.breach);
      const CommitReport next = Commit("next");
      EXPECT_EQ(next.outcome, CommitOutcome::kRefused);
      EXPECT_THAT(next.reason, HasSubstr(report.breach));
      EXPECT_THAT(next.reason, HasSubstr("bendloop acknowledge"));
    } else if (report.outcome != CommitOutcome::kCommitted) {
      // The old rows, though one that takes what is staged has them under another number.
      EXPECT_EQ(bender_->Active().program, base_.program);
    }
  }
  EXPECT_EQ(proven.size(), kProven.size());
}

// The one that cost tubes: checks nothing, or not the number, and finds the time 4 s later.
TEST_F(BenderMutants, LateAndUncheckedItEndsWithTheOldRows) {
  for (const RuleMutant unchecked : {M::kTakesAnything, M::kTakesWrongSequence}) {
    Start({M::kActivatesLate, unchecked});
    const CommitReport report = Commit();
    EXPECT_EQ(report.outcome, CommitOutcome::kFailed) << report.reason;
    EXPECT_EQ(OpenBreach(), "") << "nothing is proven yet";
    Wait(std::chrono::seconds(10));
    EXPECT_NE(bender_->Active(), base_) << "it did take what was staged";
    EXPECT_EQ(bender_->Active().program, base_.program);
    const CommitReport next = Commit("next");
    EXPECT_EQ(next.outcome, CommitOutcome::kRefused);
    EXPECT_THAT(next.reason, HasSubstr("R6: it made a program active whose number was never"));
  }
}

TEST_F(BenderMutants, RejectedAndTakenLaterItEndsWithTheOldRows) {
  Start({M::kRejectsAndActivatesLate});
  const CommitReport report = Commit();
  EXPECT_EQ(report.outcome, CommitOutcome::kRefused);
  Wait(std::chrono::seconds(10));
  EXPECT_EQ(bender_->Active().program, base_.program);
  EXPECT_THAT(Commit("next").reason, HasSubstr("corrections are locked"));
}

TEST_F(BenderMutants, TheFirstRowThatDiffersIsNamed) {
  Start({M::kCopiesRowWrongKeepsCrc});
  const CommitReport report = Commit();
  EXPECT_EQ(report.outcome, CommitOutcome::kFailed);
  EXPECT_THAT(report.reason, HasSubstr("row 1 angle_deg is "));
  ASSERT_TRUE(report.facts);
  EXPECT_EQ(report.facts->answer, hal::CommitReply::kAccepted);
  EXPECT_TRUE(report.facts->activated);
  EXPECT_EQ(report.facts->read_back, host::ReadBack::kSpoiled);
  EXPECT_THAT(journal_.Last().value()->detail,
              HasSubstr("answer: accepted; activated: yes; read back: row 1 angle_deg is "));
}

TEST_F(BenderMutants, AfterItIsAcknowledgedLifeGoesOn) {
  Start({M::kRejectsAndActivates});
  EXPECT_EQ(Commit().outcome, CommitOutcome::kCommitted) << "that is what it bends";
  bender_->memory().Break({});
  program_ = RandomProgram(random_, 4);
  EXPECT_EQ(Commit("next").outcome, CommitOutcome::kRefused);
  ASSERT_TRUE(CommitProtocol(*link_, journal_, clock_).Acknowledge("setter"));
  EXPECT_EQ(OpenBreach(), "");
  const CommitReport report = Commit("after");
  EXPECT_EQ(report.outcome, CommitOutcome::kCommitted) << report.reason;
}

TEST_F(BenderMutants, ABreachIsFoundByTheNextStartToo) {
  Start({M::kRejectsAndActivates});
  try {
    link_->swallow_commit = [this](std::uint32_t sequence) {
      bender_->Deliver(sequence);
      throw Crash{};
    };
    (void)Commit();
  } catch (const Crash&) {
  }
  ASSERT_TRUE(journal_.Unfinished().value());
  const auto resumed = CommitProtocol(*link_, journal_, clock_).Resume();
  ASSERT_TRUE(resumed);
  EXPECT_EQ(resumed->outcome, CommitOutcome::kCommitted);
  EXPECT_THAT(OpenBreach(), StartsWith("R15"));
}

// The same over real connections, where the crc stands in the way of reading.
template <class Cell>
void IsToldOver(const hal::RegisterMap& map) {
  host::CommitOptions options;
  options.reply_timeout = std::chrono::milliseconds(300);
  hal::SteadyClock clock;
  for (const RuleMutant mutant : {M::kCopiesRowWrongKeepsCrc, M::kCopiesRowWrong,
                                  M::kRejectsAndActivates, M::kCopiesNothing}) {
    const std::string name(drivers::RuleMutants()[static_cast<std::size_t>(mutant)].name);
    SCOPED_TRACE(name);
    Cell cell(map);
    CommitJournal journal = CommitJournal::Open(":memory:").value();
    CommitProtocol protocol(cell.link(), journal, clock, options);
    std::mt19937_64 random(5);
    const auto base = cell.link().ReadActive();
    ASSERT_TRUE(base);
    cell.Misbehave("break " + name);
    const CommitReport report = protocol.Commit({"scan", *base, RandomProgram(random, 4)});
    EXPECT_THAT(report.breach, StartsWith(kProven.at(mutant))) << report.reason;
    EXPECT_FALSE(protocol.Locked().empty());
  }
}

TEST(BenderFaultsOverModbus, ABreachIsTold) { IsToldOver<ModbusBenderUnderTest>(PlainMap()); }
TEST(BenderFaultsOverIsotp, ABreachIsTold) { IsToldOver<IsotpBenderUnderTest>(PlainMap()); }
TEST(BenderFaultsOverCanopen, ABreachIsTold) {
  IsToldOver<CanopenBenderUnderTest>(ObjectMap(PlainMap()));
}

}  // namespace
}  // namespace bendloop::test
