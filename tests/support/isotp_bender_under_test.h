// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <memory>
#include <string>

#include "drivers/isotp_bender/isotp_bender.h"
#include "tests/support/modbus_bender_under_test.h"

namespace bendloop::test {

// The ISO-TP link and the simulated controller, on `interface`; without one on a socket pair that
// carries whole messages, as the kernel's ISO-TP does for both. Cutting them into frames is the
// kernel's, so tests/vm has the same on a bus.
class IsotpBenderUnderTest final : public SimulatedBenderUnderTest {
 public:
  explicit IsotpBenderUnderTest(const hal::RegisterMap& map, const std::string& interface = "",
                                std::chrono::milliseconds response_timeout = kImpatient)
      : SimulatedBenderUnderTest(map), response_timeout_(response_timeout) {
    auto simulated = SimulatorOptions(map);
    if (!interface.empty()) channel_.interface = interface;
    simulated.can = channel_;
    int ends[2] = {-1, -1};
    if (interface.empty()) {
      EXPECT_EQ(socketpair(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0, ends), 0);
      channel_.socket = ends[0];
      simulated.can->socket = ends[1];
    }
    bender_ = StartBender(std::move(simulated));
    if (ends[1] >= 0) close(ends[1]);  // the bender has a copy
    link_ = drivers::MakeRegisterBender(map, Carrier());
  }
  ~IsotpBenderUnderTest() override {
    if (channel_.socket >= 0) close(channel_.socket);
  }

  // The link's registers alone: another client of the same bender.
  std::unique_ptr<drivers::RegisterCarrier> Carrier() const {
    return drivers::MakeIsotpCarrier(map_,
                                     {.channel = channel_, .response_timeout = response_timeout_});
  }

 private:
  drivers::IsotpChannel channel_{.interface = "pair", .request_id = 0x18da10f1, .reply_id = 0x7e8};
  std::chrono::milliseconds response_timeout_;
};

}  // namespace bendloop::test
