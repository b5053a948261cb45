// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <utility>

#include "drivers/modbus_bender/modbus_bender.h"
#include "drivers/simulated_bender/simulated_bender.h"
#include "tests/support/bender_maps.h"
#include "tests/support/bender_under_test.h"

namespace bendloop::test {

inline drivers::SimulatedBenderOptions SimulatorOptions(const hal::RegisterMap& map,
                                                        bool rtu = false) {
  std::mt19937_64 random(3);
  drivers::SimulatedBenderOptions options;
  options.map = map;
  options.rtu = rtu;
  options.program = {42, 3, RandomProgram(random, 4), 0};
  options.pipe_radius_mm = 10;
  options.cycle = std::chrono::milliseconds(1);
  return options;
}

inline std::unique_ptr<drivers::SimulatedBender> StartBender(
    drivers::SimulatedBenderOptions options) {
  auto bender = drivers::SimulatedBender::Start(std::move(options));
  if (!bender) {
    ADD_FAILURE() << bender.error().message;
    return nullptr;
  }
  return std::move(*bender);
}

inline drivers::ModbusBenderOptions LinkOptions(
    std::uint16_t port, std::chrono::milliseconds response_timeout = kImpatient) {
  drivers::ModbusBenderOptions options;
  options.port = port;
  options.response_timeout = response_timeout;
  options.max_backoff = std::chrono::milliseconds(1);
  return options;
}

// A link with the simulated bender at its other end; who derives makes both.
class SimulatedBenderUnderTest : public BenderUnderTest {
 public:
  hal::BenderLink& link() override { return *link_; }
  hal::ProgramBlock Active() override { return bender_->Active(); }
  hal::ProgramBlock Staged() override { return bender_->Staged(); }
  void Say(const hal::PlcOrders& orders) override { bender_->Say(orders); }
  hal::CellReport Heard() override { return bender_->Heard(); }
  const hal::RegisterMap& map() const override { return map_; }
  void Misbehave(const std::string& command) override {
    const auto done = bender_->Misbehave(command);
    EXPECT_TRUE(done) << done.error().message;
  }
  drivers::SimulatedBender& bender() { return *bender_; }

 protected:
  explicit SimulatedBenderUnderTest(hal::RegisterMap map) : map_(std::move(map)) {}

  hal::SteadyClock clock_;
  hal::RegisterMap map_;
  std::unique_ptr<drivers::SimulatedBender> bender_;
  std::unique_ptr<hal::BenderLink> link_;
};

// The Modbus link, on loopback.
class ModbusBenderUnderTest final : public SimulatedBenderUnderTest {
 public:
  explicit ModbusBenderUnderTest(const hal::RegisterMap& map, bool rtu = false,
                                 std::chrono::milliseconds response_timeout = kImpatient)
      : SimulatedBenderUnderTest(map) {
    bender_ = StartBender(SimulatorOptions(map, rtu));
    link_ = drivers::MakeModbusBender(map, LinkOptions(*bender_, response_timeout), clock_);
  }

  static drivers::ModbusBenderOptions LinkOptions(
      const drivers::SimulatedBender& bender,
      std::chrono::milliseconds response_timeout = kImpatient) {
    auto options = test::LinkOptions(bender.port(), response_timeout);
    if (!bender.device().empty()) options.serial = drivers::SerialLine{.device = bender.device()};
    return options;
  }
};

}  // namespace bendloop::test
