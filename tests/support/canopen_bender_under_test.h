// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <memory>
#include <string>
#include <utility>

#include "drivers/canopen_bender/canopen_bender.h"
#include "tests/support/modbus_bender_under_test.h"

namespace bendloop::test {

// As register-maps/canopen.toml with its dictionary, already bound. `row` says what a row is.
inline hal::RegisterMap ObjectMap(const hal::RegisterMap& row) {
  using T = hal::RegisterType;
  hal::RegisterMap map = row;
  std::uint16_t next = 0;
  const auto at = [&](std::uint16_t index, std::uint8_t sub, T type) {
    hal::RegisterField field = Field(next, type);
    field.object = {index, sub};
    next = static_cast<std::uint16_t>(next + RegisterCount(type));
    return field;
  };
  map.high_word_first = map.high_byte_first = false;
  map.mode = at(0x2000, 1, T::kUint8);
  map.fault_code = at(0x2000, 2, T::kUint16);
  map.heartbeat = at(0x2000, 3, T::kUint16);
  map.parts_bent = at(0x2000, 4, T::kUint32);
  map.commit = at(0x2001, 1, T::kUint32);
  map.reply_sequence = at(0x2001, 2, T::kUint32);
  map.reply = at(0x2001, 3, T::kUint8);
  map.reply_code = at(0x2001, 4, T::kUint16);
  const auto text = [&](std::uint16_t entry, std::uint8_t sub) {
    hal::TextField field{next, hal::RegisterSpace::kHolding, 32, {entry, sub}};
    next = static_cast<std::uint16_t>(next + field.registers());
    return field;
  };
  map.report = {};
  map.report.state = at(0x2030, 1, T::kUint8);
  map.report.sequence = at(0x2031, 1, T::kUint32);
  map.report.part_number = at(0x2031, 2, T::kUint32);
  map.report.identity = text(0x2031, 3);
  map.orders = {};
  map.orders.hold = at(0x2040, 1, T::kUint8);
  map.orders.identity = text(0x2040, 2);
  std::uint16_t index = 0x2010;
  for (hal::ProgramArea* area : {&map.active, &map.staging}) {
    *area = {at(index, 1, T::kUint32), at(index, 2, T::kUint32), at(index, 3, T::kUint16),
             at(index, 4, T::kUint32)};
    area->rows_address = next;
    area->rows_object = {static_cast<std::uint16_t>(index + 1), 0};
    next = static_cast<std::uint16_t>(next + map.max_rows * map.row_stride);
    index += 0x10;
  }
  return map;
}

// The CANopen link and the simulated node, on `interface`, or on a bus of two of their own.
class CanopenBenderUnderTest final : public SimulatedBenderUnderTest {
 public:
  explicit CanopenBenderUnderTest(const hal::RegisterMap& map, const std::string& interface = "",
                                  drivers::SdoServer::Options sdo = {},
                                  std::chrono::milliseconds response_timeout = kImpatient)
      : SimulatedBenderUnderTest(map) {
    options_.response_timeout = response_timeout;
    auto simulated = SimulatorOptions(map);
    simulated.canopen.emplace();
    simulated.canopen->interface = interface.empty() ? "pair" : interface;
    simulated.canopen->node_id = options_.node_id;
    simulated.canopen->vendor_id = options_.vendor_id;
    simulated.canopen->sdo = sdo;
    options_.interface = simulated.canopen->interface;
    int ends[2] = {-1, -1};
    if (interface.empty()) {
      EXPECT_EQ(socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends), 0);
      simulated.canopen->socket = ends[0];
      ours_ = ends[1];
    }
    // On a bus the boot-up may come a little late, and would rightly end the link's first transfer.
    auto ear = drivers::OpenCanPort(interface, {drivers::kCobHeartbeat + options_.node_id});
    bender_ = StartBender(std::move(simulated));
    const auto deadline = clock_.Now() + std::chrono::seconds(20);
    for (bool up = !ear; !up && clock_.Now() < deadline;) {
      const auto frame = (*ear)->Receive(std::chrono::seconds(1));
      up = frame && *frame && (*frame)->data[0] == 0;
    }
    map_ = map;
    link_ = drivers::MakeRegisterBender(map, Carrier());
  }
  // The link's objects alone: another client of the same bender.
  std::unique_ptr<drivers::RegisterCarrier> Carrier() {
    if (ours_ < 0) return drivers::MakeCanopenCarrier(map_, options_, clock_);
    return drivers::MakeCanopenCarrier(map_, options_, clock_,
                                       [this]() -> hal::Result<std::unique_ptr<drivers::CanPort>> {
                                         return drivers::AdoptCanSocket(dup(ours_));
                                       });
  }
  ~CanopenBenderUnderTest() override {
    if (ours_ >= 0) close(ours_);
  }

 private:
  drivers::CanopenBenderOptions options_{.node_id = 5, .vendor_id = 0x1234};
  hal::RegisterMap map_;
  int ours_ = -1;
};

}  // namespace bendloop::test
