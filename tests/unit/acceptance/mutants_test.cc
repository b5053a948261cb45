// SPDX-License-Identifier: Apache-2.0
//
// The robot finds each mutant of the simulated bender and blames the rule that it breaks.
#include <gtest/gtest.h>

#include <atomic>
#include <set>
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
    case RuleMutant::kRejectsAndActivatesLate:
      return {12};
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

TEST(AcceptanceMutants, AreAllFoundInMemory) {
  for (const RuleMutantFacts& facts : drivers::RuleMutants()) {
    if (facts.rule == 1) continue;  // the heartbeat is no matter of the memory
    SCOPED_TRACE(facts.name);
    MemoryPlc cell(PlainMap(), SimulatorOptions(PlainMap()).program);
    drivers::RuleMutantSet mutants;
    mutants.Add(facts.mutant);
    cell.memory().Break(mutants);
    const TemporaryFolder folder;
    host::Plc plc(PlainMap(), cell.Carrier(), cell.clock());
    const auto result =
        host::RunAcceptance(plc, host::RestoreFile(folder.path() / "acceptance.json"), cell, {});
    ASSERT_TRUE(result) << result.error().message;
    ExpectBlame(facts, *result);
  }
}

// The links in the test's process; ISO-TP needs the guest's kernel (tests/vm).
struct Link {
  friend void PrintTo(const Link& link, std::ostream* out) { *out << link.name; }

  const char* name;
  bool rtu;
  bool canopen;
};

class AcceptanceMutantsOn : public testing::TestWithParam<Link> {
 protected:
  static host::Acceptance Try(const RuleMutantFacts& facts) {
    const hal::RegisterMap map = GetParam().canopen ? ObjectMap(PlainMap()) : PlainMap();
    hal::SteadyClock clock;
    std::unique_ptr<SimulatedBenderUnderTest> cell;
    std::unique_ptr<drivers::RegisterCarrier> carrier;
    if (GetParam().canopen) {
      auto canopen = std::make_unique<CanopenBenderUnderTest>(map);
      carrier = canopen->Carrier();
      cell = std::move(canopen);
    } else {
      auto modbus = std::make_unique<ModbusBenderUnderTest>(map, GetParam().rtu);
      carrier = drivers::MakeModbusCarrier(
          map, ModbusBenderUnderTest::LinkOptions(modbus->bender()), clock);
      cell = std::move(modbus);
    }
    SimulatedHands hands(cell->bender(), std::string(facts.name));
    host::Plc plc(map, std::move(carrier), clock);
    const TemporaryFolder folder;
    host::BenchOptions bench = QuickBench();
    // A mutant that writes its registers one after the other is 400 ms late.
    if (facts.rule == 13 || facts.rule == 16) bench.watch = std::chrono::milliseconds(600);
    const auto result = host::RunAcceptance(
        plc, host::RestoreFile(folder.path() / "acceptance.json"), hands, {.bench = bench});
    EXPECT_TRUE(result) << result.error().message;
    return result.value_or(host::Acceptance{});
  }
};

// They wait for their benders most of the time: several at once.
TEST_P(AcceptanceMutantsOn, AreFound) {
  std::vector<RuleMutantFacts> tried;
  for (const RuleMutantFacts& facts : drivers::RuleMutants()) {
    // That each is found the memory shows; here, that the link makes no difference.
    if (tried.empty() || facts.rule > tried.back().rule) tried.push_back(facts);
  }
  constexpr int kAtOnce = 6;
  std::atomic<std::size_t> next{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < kAtOnce; ++i) {
    threads.emplace_back([&] {
      for (std::size_t at = next++; at < tried.size(); at = next++) {
        SCOPED_TRACE(tried[at].name);
        ExpectBlame(tried[at], Try(tried[at]));
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
}

INSTANTIATE_TEST_SUITE_P(Links, AcceptanceMutantsOn,
                         testing::Values(Link{"Tcp", false, false}, Link{"Rtu", true, false},
                                         Link{"Canopen", false, true}),
                         [](const auto& link) { return std::string(link.param.name); });

}  // namespace
}  // namespace bendloop::test
