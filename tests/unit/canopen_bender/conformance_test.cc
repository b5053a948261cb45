// SPDX-License-Identifier: Apache-2.0
//
// The link with the simulated node, on a socket pair in place of a bus; on a real kernel's CAN it
// is in tests/vm.
#include "config/load.h"
#include "config/object_dictionary.h"
#include "tests/support/bender_link_conformance.h"
#include "tests/support/canopen_bender_under_test.h"

namespace bendloop::test {
namespace {

BenderFactory Shipped() {
  return {"shipped", [](std::chrono::milliseconds response_timeout) {
            const std::string config = BENDLOOP_SOURCE_DIR "/config/";
            auto map = config::LoadRegisterMap(config + "register-maps/canopen.toml");
            EXPECT_TRUE(map) << map.error().message;
            const auto eds =
                config::LoadObjectDictionary(config + "object-dictionaries/default.eds");
            EXPECT_TRUE(eds) << eds.error().message;
            const auto bound = config::BindObjects(*map, *eds);
            EXPECT_TRUE(bound) << bound.error().message;
            return std::make_unique<CanopenBenderUnderTest>(*map, "", drivers::SdoServer::Options{},
                                                            response_timeout);
          }};
}

// Odd rows, no block transfer.
BenderFactory Odd() {
  return {"odd", [](std::chrono::milliseconds response_timeout) {
            return std::make_unique<CanopenBenderUnderTest>(
                ObjectMap(OddMap()), "", drivers::SdoServer::Options{false, 1}, response_timeout);
          }};
}

INSTANTIATE_TEST_SUITE_P(Canopen, BenderLinkConformance, testing::Values(Shipped(), Odd()),
                         [](const auto& factory) { return factory.param.name; });

TEST(CanopenBender, SaysWhatIsWrongInTheWordsOfTheStandard) {
  CanopenBenderUnderTest cell(ObjectMap(PlainMap()));
  ASSERT_TRUE(cell.link().ReadState());
  cell.Misbehave("exception 4");
  const auto aborted = cell.link().ReadState();
  ASSERT_FALSE(aborted);
  EXPECT_EQ(aborted.error().message,
            "bender pair node 5: read 2000sub1: the bender aborts: 0x08000024, no data available");
  cell.Misbehave("behave");
  cell.Misbehave("lying-rows");
  const auto lying = cell.link().ReadActive();
  ASSERT_FALSE(lying);
  EXPECT_EQ(
      lying.error().message,
      "bender pair node 5: row_count: object 2010sub3 says 41 rows; at most 40 were expected");
}

// drivers/README.md shows this one.
TEST(CanopenBender, WorkedExampleOfTheCrc) {
  CanopenBenderUnderTest cell(ObjectMap(PlainMap()));
  const auto encoded = cell.link().Encode({7, 12, {{{100, 0, 45.5, 30}, {80.25, 0, 0, {}}}}, 0});
  ASSERT_TRUE(encoded) << encoded.error().message;
  EXPECT_EQ(encoded->crc, 0x29B6029Cu);
}

TEST(CanopenBender, HeartbeatAndEmergencyStandInForObjectsThatAreNotThere) {
  hal::RegisterMap map = ObjectMap(PlainMap());
  map.heartbeat.reset();
  map.fault_code.reset();
  CanopenBenderUnderTest cell(map);
  const auto info = cell.link().Connect();
  ASSERT_TRUE(info) << info.error().message;
  EXPECT_TRUE(info->has_heartbeat);
  EXPECT_NE(info->description.find("CANopen pair node 5"), std::string::npos);
  const auto first = cell.link().ReadState();
  ASSERT_TRUE(first) << first.error().message;
  EXPECT_EQ(first->fault_code, 0u);
  cell.Misbehave("mode fault");
  hal::SteadyClock clock;
  const auto deadline = clock.Now() + std::chrono::seconds(20);
  hal::BenderState state = *first;
  while ((state.heartbeat == first->heartbeat || state.fault_code == 0) && clock.Now() < deadline) {
    if (const auto now = cell.link().ReadState()) state = *now;
  }
  EXPECT_NE(state.heartbeat, first->heartbeat);
  EXPECT_EQ(state.fault_code, 0xff63u);
}

}  // namespace
}  // namespace bendloop::test
