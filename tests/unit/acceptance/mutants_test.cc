// SPDX-License-Identifier: Apache-2.0
//
// The robot finds each mutant of the simulated bender and blames the rule that it breaks.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "drivers/modbus_bender/modbus_bender.h"
#include "drivers/simulated_bender/rule_mutant.h"
#include "firmware-host/acceptance/robot.h"
#include "tests/unit/acceptance/memory_plc.h"
#include "tests/unit/acceptance/simulated_cell.h"

namespace bendloop::test {
namespace {

using drivers::RuleMutant;
using drivers::RuleMutantFacts;

// What else a mutant cannot help to break, beside its own rule.
std::set<int> AlsoBroken(RuleMutant mutant) {
  switch (mutant) {
    case RuleMutant::kTakesAnything:
      return {5, 6, 7, 8, 9, 10, 11};
    case RuleMutant::kIdleWhenNotReady:  // when its power comes back, for a moment
      return {12};
    case RuleMutant::kRejectsAndActivatesLate:  // on a loaded machine in the middle of a staging
      return {4, 12};
    case RuleMutant::kAnswersBeforeCopying:  // long before, on a loaded machine
      return {4};
    case RuleMutant::kSequence15Bits:
      return {13, 16};
    case RuleMutant::kOtherCrc:
      return {18};
    default:
      return {};
  }
}

std::set<int> BrokenRules(const host::Acceptance& result) {
  std::set<int> broken;
  for (std::size_t i = 0; i < host::kRuleCount; ++i) {
    if (result.rules[i].outcome == host::Outcome::kFailed) broken.insert(static_cast<int>(i) + 1);
  }
  return broken;
}

void ExpectBlame(const RuleMutantFacts& facts, const host::Acceptance& result) {
  std::set<int> broken = BrokenRules(result);
  EXPECT_TRUE(broken.count(facts.rule)) << "R" << facts.rule << " is not blamed";
  EXPECT_FALSE(result.passed());
  broken.erase(facts.rule);
  for (const int also : AlsoBroken(facts.mutant)) broken.erase(also);
  EXPECT_TRUE(broken.empty()) << Broken(result);
}

// `stalls_each`: 0, or how many exchanges there are between two stalls of the robot's machine.
host::Acceptance RunInMemory(std::optional<RuleMutant> mutant, std::size_t stalls_each = 0) {
  MemoryPlc cell(PlainMap(), SimulatorOptions(PlainMap()).program);
  drivers::RuleMutantSet mutants;
  if (mutant) mutants.Add(*mutant);
  cell.memory().Break(mutants);
  cell.Stall(stalls_each, std::chrono::milliseconds(1500));
  const TemporaryFolder folder;
  host::Plc plc(PlainMap(), cell.Carrier(), cell.clock());
  const auto result =
      host::RunAcceptance(plc, host::RestoreFile(folder.path() / "acceptance.json"), cell, {});
  EXPECT_TRUE(result) << result.error().message;
  return result.value_or(host::Acceptance{});
}

TEST(AcceptanceMutants, AreAllFoundInMemory) {
  for (const RuleMutantFacts& facts : drivers::RuleMutants()) {
    if (facts.rule == 1) continue;  // the heartbeat is no matter of the memory
    SCOPED_TRACE(facts.name);
    ExpectBlame(facts, RunInMemory(facts.mutant));
  }
}

// That the robot's own machine does nothing for seconds, whenever that is, is not the PLC's fault.
TEST(AcceptanceMutants, AreBlamedOnALoadedMachineForNothingElse) {
  for (const std::size_t each : {2, 3, 5, 7, 11}) {
    SCOPED_TRACE("a stall each " + std::to_string(each) + " exchanges");
    EXPECT_EQ(Broken(RunInMemory(std::nullopt, each)), "");
  }
  // One stall may hide what a mutant does for 400 ms, and not every one of a few commits has one.
  constexpr RuleMutantFacts kFacts{RuleMutant::kCopiesInTwoScans, 13, {}, {}};
  for (const std::size_t each : {17, 23, 29, 31}) {
    SCOPED_TRACE("a stall each " + std::to_string(each) + " exchanges");
    ExpectBlame(kFacts, RunInMemory(kFacts.mutant, each));
  }
}

enum class Link { kTcp, kRtu, kIsotp, kCanopen };
constexpr Link kLinks[] = {Link::kTcp, Link::kRtu, Link::kIsotp, Link::kCanopen};

std::string NameOf(Link link) {
  constexpr const char* kNames[] = {"Tcp", "Rtu", "Isotp", "Canopen"};
  return kNames[static_cast<std::size_t>(link)];
}
void PrintTo(Link link, std::ostream* out) { *out << NameOf(link); }

// What is late does so by 400 ms: it is waited for after each of some fifty commits.
bool IsLate(const RuleMutantFacts& facts) { return facts.rule == 13 || facts.rule == 16; }

host::Acceptance RunOn(const RuleMutantFacts& facts, drivers::SimulatedBender& bender,
                       const hal::RegisterMap& map,
                       std::unique_ptr<drivers::RegisterCarrier> carrier) {
  hal::SteadyClock clock;
  SimulatedHands hands(bender, std::string(facts.name));
  host::Plc plc(map, std::move(carrier), clock);
  const TemporaryFolder folder;
  host::BenchOptions bench = QuickBench();
  if (IsLate(facts)) {
    bench.watch = std::chrono::milliseconds(600);
    bench.reply_timeout = std::chrono::seconds(2);  // a loaded machine is late, too
  }
  if (facts.mutant == RuleMutant::kRejectsAndActivatesLate) {  // by 4 s
    bench.late = host::BenchOptions{}.late;
  }
  const auto result = host::RunAcceptance(plc, host::RestoreFile(folder.path() / "acceptance.json"),
                                          hands, {.bench = bench});
  EXPECT_TRUE(result) << result.error().message;
  return result.value_or(host::Acceptance{});
}

host::Acceptance Try(Link link, const RuleMutantFacts& facts) {
  const hal::RegisterMap map = PlainMap();
  switch (link) {
    case Link::kIsotp: {
      IsotpBenderUnderTest cell(map);
      return RunOn(facts, cell.bender(), map, cell.Carrier());
    }
    case Link::kCanopen: {
      CanopenBenderUnderTest cell(ObjectMap(map));
      return RunOn(facts, cell.bender(), cell.map(), cell.Carrier());
    }
    case Link::kTcp:
    case Link::kRtu:
      break;
  }
  hal::SteadyClock clock;
  ModbusBenderUnderTest cell(map, link == Link::kRtu);
  return RunOn(
      facts, cell.bender(), map,
      drivers::MakeModbusCarrier(map, ModbusBenderUnderTest::LinkOptions(cell.bender()), clock));
}

struct Trial {
  Link link;
  RuleMutantFacts facts;
};

// Each mutant is found on its link, by its rule and no other. They wait for their benders most of
// the time: several at once, the longest first.
void ExpectFound(std::vector<Trial> trials) {
  std::stable_partition(trials.begin(), trials.end(),
                        [](const Trial& trial) { return IsLate(trial.facts); });
  constexpr int kAtOnce = 10;
  std::atomic<std::size_t> next{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < kAtOnce; ++i) {
    threads.emplace_back([&] {
      for (std::size_t at = next++; at < trials.size(); at = next++) {
        const auto& [link, facts] = trials[at];
        SCOPED_TRACE(NameOf(link) + " " + std::string(facts.name));
        ExpectBlame(facts, Try(link, facts));
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
}

// That all are found the memory shows; here, that a link makes no difference: each link has its
// share.
TEST(AcceptanceMutants, AreFoundEachOnOneOfTheLinks) {
  std::vector<Trial> trials;
  for (const RuleMutantFacts& facts : drivers::RuleMutants()) {
    const Link link = kLinks[trials.size() % std::size(kLinks)];
    // Nearly two minutes of waiting: with all the others, below.
    if (facts.mutant == RuleMutant::kReplySequenceFirst) continue;
    trials.push_back({link, facts});
  }
  ExpectFound(std::move(trials));
}

class AcceptanceMutantsOn : public testing::TestWithParam<Link> {};

TEST_P(AcceptanceMutantsOn, AllAreFound) {
  std::vector<Trial> trials;
  for (const RuleMutantFacts& facts : drivers::RuleMutants()) trials.push_back({GetParam(), facts});
  ExpectFound(std::move(trials));
}

INSTANTIATE_TEST_SUITE_P(Links, AcceptanceMutantsOn, testing::ValuesIn(kLinks),
                         [](const auto& link) { return NameOf(link.param); });

}  // namespace
}  // namespace bendloop::test
