// SPDX-License-Identifier: Apache-2.0
//
// The link over a real kernel's ISO-TP sockets on vcan0; run in a guest (can_isotp.sh).
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <thread>

#include "tests/support/bender_link_conformance.h"
#include "tests/support/modbus_bender_under_test.h"

namespace bendloop::test {
namespace {

drivers::CanChannel Channel() { return {"vcan0", 0x18da10f1, 0x7e8}; }

class CanBenderUnderTest final : public BenderUnderTest {
 public:
  explicit CanBenderUnderTest(const hal::RegisterMap& map) {
    auto simulated = SimulatorOptions(map);
    simulated.can = Channel();
    bender_ = StartBender(std::move(simulated));
    auto options = LinkOptions(0);
    options.can = Channel();
    link_ = drivers::MakeModbusBender(map, options, clock_);
  }
  hal::BenderLink& link() override { return *link_; }
  hal::ProgramBlock Active() override { return bender_->Active(); }
  hal::ProgramBlock Staged() override { return bender_->Staged(); }
  void Misbehave(const std::string& command) override {
    const auto done = bender_->Misbehave(command);
    EXPECT_TRUE(done) << done.error().message;
  }

 private:
  hal::SteadyClock clock_;
  std::unique_ptr<drivers::SimulatedBender> bender_;
  std::unique_ptr<hal::BenderLink> link_;
};

BenderFactory Can(const hal::RegisterMap& map) {
  return {map.name, [map] { return std::make_unique<CanBenderUnderTest>(map); }};
}

INSTANTIATE_TEST_SUITE_P(Can, BenderLinkConformance,
                         testing::Values(Can(PlainMap()), Can(OddMap())),
                         [](const auto& factory) { return factory.param.name; });

TEST(CanBus, ForeignTrafficDoesNotDisturb) {
  CanBenderUnderTest cell(PlainMap());
  std::atomic<bool> done{false};
  std::atomic<int> frames{0};
  std::thread neighbour([&] {
    const int bus = socket(PF_CAN, SOCK_RAW, CAN_RAW);
    sockaddr_can address{};
    address.can_family = AF_CAN;
    address.can_ifindex = static_cast<int>(if_nametoindex("vcan0"));
    EXPECT_EQ(bind(bus, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    can_frame frame{};
    frame.can_dlc = 8;
    while (!done) {
      frame.can_id = static_cast<canid_t>(frames % 0x700);  // every one but ours
      if (write(bus, &frame, sizeof frame) == sizeof frame) ++frames;
    }
    close(bus);
  });
  while (frames == 0) std::this_thread::yield();
  for (int i = 0; i < 50; ++i) {
    const auto active = cell.link().ReadActive();
    EXPECT_TRUE(active) << active.error().message;
  }
  done = true;
  neighbour.join();
  EXPECT_GT(frames, 100);
}

TEST(CanBus, SaysWhatIsWrong) {
  hal::SteadyClock clock;
  auto options = LinkOptions(0);
  options.can = drivers::CanChannel{"nocan7", 1, 2};
  auto link = drivers::MakeModbusBender(PlainMap(), options, clock);
  const auto missing = link->ReadState();
  ASSERT_FALSE(missing);
  EXPECT_NE(missing.error().message.find("none of that name"), std::string::npos)
      << missing.error().message;

  options.can = Channel();  // nobody is there: no flow control, no answer
  link = drivers::MakeModbusBender(PlainMap(), options, clock);
  const auto silent = link->ReadState();
  ASSERT_FALSE(silent);
  EXPECT_EQ(silent.error().kind, hal::ErrorKind::kDevice);

  options.can->interface = "vcan1";  // exists, but is down
  link = drivers::MakeModbusBender(PlainMap(), options, clock);
  const auto down = link->ReadState();
  ASSERT_FALSE(down);
  EXPECT_NE(down.error().message.find("is down"), std::string::npos) << down.error().message;
}

}  // namespace
}  // namespace bendloop::test
