// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acceptance/robot.h"

#include <gtest/gtest.h>

#include "drivers/modbus_bender/modbus_bender.h"
#include "tests/unit/acceptance/simulated_cell.h"

namespace bendloop::test {
namespace {

host::Acceptance Try(drivers::SimulatedBender& bender, const hal::RegisterMap& map,
                     std::unique_ptr<drivers::RegisterCarrier> carrier, hal::Clock& clock) {
  const TemporaryFolder folder;
  const host::RestoreFile file(folder.path() / "acceptance.json");
  host::Plc plc(map, std::move(carrier), clock);
  SimulatedHands hands(bender);
  auto result = host::RunAcceptance(plc, file, hands, {.bench = QuickBench()});
  EXPECT_TRUE(result) << result.error().message;
  EXPECT_FALSE(std::filesystem::exists(file.path()));
  return result.value_or(host::Acceptance{});
}

void ExpectPassed(drivers::SimulatedBender& bender, const hal::RegisterMap& map,
                  std::unique_ptr<drivers::RegisterCarrier> carrier) {
  hal::SteadyClock clock;
  const hal::ProgramBlock before = bender.Active();
  const host::Acceptance result = Try(bender, map, std::move(carrier), clock);
  EXPECT_EQ(Broken(result), "");
  EXPECT_EQ(Untried(result), map.heartbeat ? "" : "R1 ");
  EXPECT_TRUE(result.passed());
  EXPECT_EQ(bender.Active(), before);
  EXPECT_EQ(bender.Staged().sequence, 0u);
  EXPECT_GT(result.exchanges.size(), 130u);
  for (const host::Exchange& exchange : result.exchanges) {
    EXPECT_NE(exchange.outcome, host::Outcome::kFailed) << exchange.name << exchange.detail;
  }
}

TEST(AcceptanceRobot, PassesTheSimulatedBenderOverTcp) {
  for (const hal::RegisterMap& map : {PlainMap(), OddMap()}) {
    SCOPED_TRACE(map.name);
    hal::SteadyClock clock;
    const auto bender = StartBender(SimulatorOptions(map));
    ExpectPassed(*bender, map, drivers::MakeModbusCarrier(map, LinkOptions(bender->port()), clock));
  }
}

TEST(AcceptanceRobot, PassesTheSimulatedBenderOnASerialLine) {
  hal::SteadyClock clock;
  const hal::RegisterMap map = PlainMap();
  const auto bender = StartBender(SimulatorOptions(map, true));
  ExpectPassed(*bender, map,
               drivers::MakeModbusCarrier(map, ModbusBenderUnderTest::LinkOptions(*bender), clock));
}

TEST(AcceptanceRobot, PassesTheSimulatedBenderOverCanopen) {
  const hal::RegisterMap map = ObjectMap(PlainMap());
  CanopenBenderUnderTest cell(map);
  ExpectPassed(cell.bender(), map, cell.Carrier());
}

TEST(AcceptanceRobot, PassesTheSimulatedBenderOverIsotp) {
  const hal::RegisterMap map = PlainMap();
  IsotpBenderUnderTest cell(map);
  ExpectPassed(cell.bender(), map, cell.Carrier());
}

}  // namespace
}  // namespace bendloop::test
