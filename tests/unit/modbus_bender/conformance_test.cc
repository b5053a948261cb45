// SPDX-License-Identifier: Apache-2.0
#include "config/load.h"
#include "tests/support/bender_link_conformance.h"
#include "tests/support/isotp_bender_under_test.h"
#include "tests/support/modbus_bender_under_test.h"

namespace bendloop::test {
namespace {

BenderFactory Factory(const hal::RegisterMap& map) {
  return {map.name, [map](std::chrono::milliseconds response_timeout) {
            return std::make_unique<ModbusBenderUnderTest>(map, false, response_timeout);
          }};
}

// As the plain one, but with the bytes of a register and the words of a value exchanged.
hal::RegisterMap SwappedMap() {
  hal::RegisterMap map = PlainMap();
  map.name = "swapped";
  map.high_byte_first = false;
  map.high_word_first = false;
  return map;
}

// A map that we ship; the name is that of its file.
BenderFactory Shipped(const std::string& name) {
  const std::string file = BENDLOOP_SOURCE_DIR "/config/register-maps/" + name + ".toml";
  return {name.substr(0, name.find('-')), [file](std::chrono::milliseconds response_timeout) {
            const auto map = config::LoadRegisterMap(file);
            EXPECT_TRUE(map) << map.error().message;
            return std::make_unique<ModbusBenderUnderTest>(map.value_or(hal::RegisterMap{}), false,
                                                           response_timeout);
          }};
}

INSTANTIATE_TEST_SUITE_P(Modbus, BenderLinkConformance,
                         testing::Values(Factory(PlainMap()), Factory(OddMap()),
                                         Factory(SwappedMap()), Shipped("default"),
                                         Shipped("siemens-like")),
                         [](const auto& factory) { return factory.param.name; });

BenderFactory Rtu(const hal::RegisterMap& map) {
  return {map.name, [map](std::chrono::milliseconds response_timeout) {
            return std::make_unique<ModbusBenderUnderTest>(map, true, response_timeout);
          }};
}

INSTANTIATE_TEST_SUITE_P(ModbusRtu, BenderLinkConformance,
                         testing::Values(Rtu(PlainMap()), Rtu(OddMap())),
                         [](const auto& factory) { return factory.param.name; });

INSTANTIATE_TEST_SUITE_P(ModbusInIsotp, BenderLinkConformance,
                         testing::Values(BenderFactory{
                             "plain",
                             [](std::chrono::milliseconds response_timeout) {
                               return std::make_unique<IsotpBenderUnderTest>(PlainMap(), "",
                                                                             response_timeout);
                             }}),
                         [](const auto& factory) { return factory.param.name; });

// A PLC that takes nothing does not notice what stays as it is.
TEST(ModbusReport, OnlyWhatHasChangedIsWritten) {
  ModbusBenderUnderTest cell(PlainMap());
  hal::CellReport report = SampleReport();
  ASSERT_TRUE(cell.link().Report(report));
  cell.Misbehave("refuse-report");
  EXPECT_TRUE(cell.link().Report(report));
  report.state = hal::CellState::kIdle;
  EXPECT_FALSE(cell.link().Report(report));
  cell.Misbehave("behave");
  EXPECT_TRUE(cell.link().Report(report));
  EXPECT_EQ(cell.Heard().state, hal::CellState::kIdle);
}

TEST(ModbusRtuLine, SaysWhatIsWrongWithThePort) {
  hal::SteadyClock clock;
  drivers::ModbusBenderOptions options;
  options.serial = drivers::SerialLine{.device = "/dev/no-such-port"};
  auto link = drivers::MakeModbusBender(PlainMap(), options, clock);
  const auto missing = link->ReadState();
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().message,
            "bender /dev/no-such-port unit 1: cannot connect: No such file or directory");

  // However often it is asked, and however near the next try is, it says the same.
  for (int i = 0; i < 3; ++i) {
    const auto again = link->ReadState();
    ASSERT_FALSE(again);
    EXPECT_EQ(again.error().message, missing.error().message);
  }

  ModbusBenderUnderTest cell(PlainMap(), true);  // a pseudo-terminal knows no RS-485
  options.serial = drivers::SerialLine{.device = cell.bender().device(), .rs485 = true};
  link = drivers::MakeModbusBender(PlainMap(), options, clock);
  const auto refused = link->ReadState();
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("cannot switch an RS-485 line"), std::string::npos)
      << refused.error().message;
  EXPECT_TRUE(cell.link().ReadState());
}

}  // namespace
}  // namespace bendloop::test
