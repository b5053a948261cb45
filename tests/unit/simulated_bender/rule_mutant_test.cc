// SPDX-License-Identifier: Apache-2.0
//
// Each mutant of the simulated bender shows itself in the same conversation, on each carrier, and a
// bender that keeps the rules says the same each time.
#include "drivers/simulated_bender/rule_mutant.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <set>
#include <sstream>

#include "drivers/register_bender/field_codec.h"
#include "drivers/register_bender/program_codec.h"
#include "drivers/simulated_bender/bender_memory.h"
#include "tests/support/canopen_bender_under_test.h"
#include "tests/support/isotp_bender_under_test.h"
#include "tests/support/modbus_bender_under_test.h"

namespace bendloop::drivers {
namespace {

using test::BenderUnderTest;

TEST(RuleMutants, EachHasANameARuleAndASentence) {
  std::set<std::string_view> names;
  for (const RuleMutantFacts& facts : RuleMutants()) {
    EXPECT_EQ(static_cast<std::size_t>(facts.mutant), names.size()) << facts.name;
    EXPECT_TRUE(names.insert(facts.name).second) << facts.name;
    EXPECT_EQ(FindRuleMutant(facts.name), facts.mutant);
    EXPECT_GE(facts.rule, 1);
    EXPECT_LE(facts.rule, 18);
    EXPECT_FALSE(facts.sentence.empty());
    EXPECT_THAT(RuleMutantHelp(), testing::HasSubstr(std::string(facts.name)));
  }
  EXPECT_FALSE(FindRuleMutant("dance"));
}

// A conversation that tries each rule but the first, and what came of each step.
class Conversation {
 public:
  explicit Conversation(BenderUnderTest& bender) : bender_(bender) {}

  std::string Run() {
    ModesAndEdit();
    GoodCommit();
    WrongCommits();
    Numbers();
    PowerLoss();
    return text_.str();
  }

 private:
  hal::BenderLink& link() { return bender_.link(); }

  static std::string Rows(const hal::Result<hal::ProgramBlock>& block) {
    if (!block) return "unreadable";
    std::ostringstream text;
    text << block->part_number << "/" << block->sequence << "/" << block->crc;
    for (const hal::BendRow& row : block->program.rows) {
      text << " " << row.length_mm << "," << row.rotation_deg << "," << row.angle_deg;
    }
    return text.str();
  }
  void Look(const char* what) {
    const auto state = link().ReadState();
    text_ << what << ": ";
    if (state) {
      text_ << static_cast<int>(state->mode) << " reply " << state->reply_sequence << "/"
            << static_cast<int>(state->reply) << "/" << state->reply_code;
    } else {
      text_ << "no state";
    }
    text_ << " active " << Rows(link().ReadActive()) << " staged " << Rows(link().ReadStaged())
          << "\n";
  }
  void Stage(const char* what, const hal::ProgramBlock& block) {
    EXPECT_TRUE(link().Stage(block)) << what;
  }
  void Try(const char* what, const hal::ProgramBlock& block, std::uint32_t commit) {
    Stage(what, block);
    EXPECT_TRUE(link().Commit(commit)) << what;
    Look(what);
  }
  hal::ProgramBlock Good(std::uint32_t sequence) {
    return {42, sequence, test::RandomProgram(random_, 5), 0};
  }

  void ModesAndEdit() {
    for (const char* mode : {"bending", "not-ready", "idle"}) {
      bender_.Misbehave(std::string("mode ") + mode);
      Look(mode);
    }
    bender_.Misbehave("edit 0.5");
    Look("edit");
  }
  void GoodCommit() {
    Stage("good", Good(10));
    Look("staged");
    EXPECT_TRUE(link().Commit(10));
    Look("committed");
    EXPECT_TRUE(link().Commit(10));
    Look("committed again");
  }
  void WrongCommits() {
    hal::ProgramBlock block = Good(11);
    Try("zero", block, 0);
    Try("other number", block, 12);
    bender_.Misbehave("mode not-ready");
    Try("not ready", Good(13), 13);
    bender_.Misbehave("mode idle");
    Stage("whole", Good(14));  // then half of another with this number
    bender_.Misbehave("half-write");
    Try("half-written", Good(14), 14);
    block = Good(15);
    block.program.rows.resize(1);
    block.program.rows[0].angle_deg = 0;
    Try("one row", block, 15);
    block = Good(16);
    block.program.rows[1].angle_deg = 360;
    Try("a whole turn", block, 16);
    block = Good(17);
    block.part_number = 43;
    Try("other part", block, 17);
  }
  void Numbers() {
    Try("above 15 bits", Good(40000), 40000);
    Try("active already", Good(40000), 1);
    Try("active already", Good(40000), 40000);
    Try("after the largest", Good(18), 18);
  }
  void PowerLoss() {
    Stage("before the power loss", Good(19));
    bender_.Misbehave("reboot");
    hal::SteadyClock clock;
    const auto deadline = clock.Now() + std::chrono::seconds(20);
    int failures = 0;  // the first while the link connects anew; with a mode unnamed, all
    for (bool idle = false; !idle && failures < 50 && clock.Now() < deadline;) {
      const auto state = link().ReadState();
      idle = state && state->mode == hal::BenderMode::kIdle;
      failures += !state;
    }
    Look("power is back");
  }

  BenderUnderTest& bender_;
  std::mt19937_64 random_{4};
  std::ostringstream text_;
};

struct Carrier {
  friend void PrintTo(const Carrier& carrier, std::ostream* out) { *out << carrier.name; }

  const char* name;
  bool all;
  std::function<std::unique_ptr<BenderUnderTest>()> start;
};

class RuleMutantsOn : public testing::TestWithParam<Carrier> {
 protected:
  static std::string Says(const std::string& mutant) {
    const auto bender = GetParam().start();
    if (!mutant.empty()) bender->Misbehave("break " + mutant);
    Conversation conversation(*bender);
    return conversation.Run();
  }
};

TEST_P(RuleMutantsOn, EachButTheHeartbeatsShowsItself) {
  const std::string good = Says("");
  EXPECT_TRUE(Says("") == good);
  int rule = 1;
  for (const RuleMutantFacts& facts : RuleMutants()) {
    // A link sends no such count; below.
    if (facts.rule == 1 || facts.mutant == RuleMutant::kTakesTooManyRows) continue;
    // What a mutant does is the same on all carriers; that it does it is looked at once a rule.
    if (!GetParam().all && std::exchange(rule, facts.rule) == facts.rule) continue;
    EXPECT_FALSE(Says(std::string(facts.name)) == good) << facts.name << ": " << facts.sentence;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Carriers, RuleMutantsOn,
    testing::Values(Carrier{"Tcp", true,
                            [] {
                              return std::make_unique<test::ModbusBenderUnderTest>(
                                  test::PlainMap(), false, test::kPatient);
                            }},
                    Carrier{"Rtu", false,
                            [] {
                              return std::make_unique<test::ModbusBenderUnderTest>(
                                  test::PlainMap(), true, test::kPatient);
                            }},
                    Carrier{"Isotp", false,
                            [] {
                              return std::make_unique<test::IsotpBenderUnderTest>(
                                  test::PlainMap(), "", test::kPatient);
                            }},
                    Carrier{"Canopen", false,
                            [] {
                              return std::make_unique<test::CanopenBenderUnderTest>(
                                  test::ObjectMap(test::PlainMap()), "", SdoServer::Options{},
                                  test::kPatient);
                            }}),
    [](const auto& carrier) { return std::string(carrier.param.name); });

// Does the heartbeat move within a time in which a good one moves ten times?
bool Beats(BenderUnderTest& bender) {
  hal::SteadyClock clock;
  const auto first = bender.link().ReadState();
  for (const auto end = clock.Now() + std::chrono::milliseconds(100); clock.Now() < end;) {
    const auto state = bender.link().ReadState();
    if (first && state && state->heartbeat != first->heartbeat) return true;
  }
  return false;
}

TEST(RuleMutants, HeartbeatsThatStand) {
  test::ModbusBenderUnderTest bender(test::PlainMap());
  bender.Misbehave("break heartbeat-stands");
  EXPECT_FALSE(Beats(bender));
  bender.Misbehave("behave");
  bender.Misbehave("break heartbeat-slow");
  EXPECT_FALSE(Beats(bender) && Beats(bender)) << "one beat may fall into the time";
  bender.Misbehave("behave");
  bender.Misbehave("break heartbeat-stops-at-fault");
  bender.Misbehave("mode fault");
  EXPECT_FALSE(Beats(bender));
}

// More rows than its area has: the crc over those it has, and only the mutant takes them.
TEST(RuleMutants, TooManyRows) {
  for (const bool broken : {false, true}) {
    const hal::RegisterMap map = test::PlainMap();
    BenderMemory memory(map);
    std::mt19937_64 random(1);
    ASSERT_TRUE(memory.LoadActive({42, 1, test::RandomProgram(random, 3), 0}));
    RuleMutantSet mutants;
    if (broken) mutants.Add(RuleMutant::kTakesTooManyRows);
    memory.Break(mutants);
    ASSERT_TRUE(EncodeProgram(map, map.staging, {42, 2, test::RandomProgram(random, 4), 0},
                              memory.image()));
    const auto put = [&](const hal::RegisterField& field, std::uint32_t value) {
      ASSERT_TRUE(PutField(map, field, value, "field", memory.image()));
    };
    put(map.staging.row_count, map.max_rows + 1u);
    memory.SetState({.mode = hal::BenderMode::kIdle});
    put(*map.commit, 2);
    ASSERT_TRUE(memory.AfterWrite(RangeOf(*map.commit)));
    memory.HandleCommit(0);
    EXPECT_EQ(memory.accepted(), broken ? 1u : 0u);
    EXPECT_EQ(memory.Active()->program.rows.size(), broken ? map.max_rows : 4u);
  }
}

}  // namespace
}  // namespace bendloop::drivers
