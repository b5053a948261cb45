// SPDX-License-Identifier: Apache-2.0
//
// The links over a real kernel's CAN sockets on vcan0; run in a guest (can_bender.sh).
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <functional>
#include <thread>

#include "tests/support/bender_link_conformance.h"
#include "tests/support/canopen_bender_under_test.h"
#include "tests/support/isotp_bender_under_test.h"

namespace bendloop::test {
namespace {

// That of the bender under test.
drivers::IsotpChannel Channel() {
  return {.interface = "vcan0", .request_id = 0x18da10f1, .reply_id = 0x7e8};
}

BenderFactory Isotp(const hal::RegisterMap& map) {
  return {"isotp_" + map.name, [map](std::chrono::milliseconds response_timeout) {
            return std::make_unique<IsotpBenderUnderTest>(map, "vcan0", response_timeout);
          }};
}

BenderFactory Canopen(const hal::RegisterMap& rows) {
  return {"canopen_" + rows.name,
          [map = ObjectMap(rows)](std::chrono::milliseconds response_timeout) {
            return std::make_unique<CanopenBenderUnderTest>(
                map, "vcan0", drivers::SdoServer::Options{}, response_timeout);
          }};
}

INSTANTIATE_TEST_SUITE_P(Can, BenderLinkConformance,
                         testing::Values(Isotp(PlainMap()), Canopen(PlainMap())),
                         [](const auto& factory) { return factory.param.name; });

// Somebody else on vcan0, who sends what `next` gives as fast as it goes.
class Neighbour {
 public:
  explicit Neighbour(std::function<can_frame(int)> next)
      : thread_([this, next = std::move(next)] {
          const int bus = socket(PF_CAN, SOCK_RAW, CAN_RAW);
          sockaddr_can address{};
          address.can_family = AF_CAN;
          address.can_ifindex = static_cast<int>(if_nametoindex("vcan0"));
          EXPECT_EQ(bind(bus, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
          while (!done_) {
            const can_frame frame = next(frames_);
            if (write(bus, &frame, sizeof frame) == sizeof frame) ++frames_;
          }
          close(bus);
        }) {
    while (frames_ == 0) std::this_thread::yield();
  }
  ~Neighbour() {
    done_ = true;
    thread_.join();
  }
  int frames() const { return frames_; }

 private:
  std::atomic<bool> done_{false};
  std::atomic<int> frames_{0};
  std::thread thread_;
};

void DoesNotDisturb(BenderUnderTest& cell) {
  const Neighbour neighbour([](int count) {
    can_frame frame{};
    frame.can_dlc = 8;
    frame.can_id = static_cast<canid_t>(1 + count % 0x6fe);
    // Every identifier but ours: of the ISO-TP channel, and of node 5.
    if ((frame.can_id & 0x7f) == 5) ++frame.can_id;
    return frame;
  });
  for (int i = 0; i < 50; ++i) {
    const auto active = cell.link().ReadActive();
    EXPECT_TRUE(active) << active.error().message;
  }
  EXPECT_GT(neighbour.frames(), 100);
  ASSERT_TRUE(cell.link().Stage(cell.Active()));
  EXPECT_EQ(cell.Staged(), cell.Active());
}

TEST(CanBus, ForeignTrafficDoesNotDisturbIsotp) {
  IsotpBenderUnderTest cell(PlainMap(), "vcan0");
  DoesNotDisturb(cell);
}

TEST(CanBus, ForeignTrafficDoesNotDisturbCanopen) {
  CanopenBenderUnderTest cell(ObjectMap(PlainMap()), "vcan0");
  DoesNotDisturb(cell);
}

TEST(CanBus, BusOffEndsATransferInWords) {
  const Neighbour controller([](int) {
    can_frame frame{};
    frame.can_id = CAN_ERR_FLAG | CAN_ERR_BUSOFF;
    frame.can_dlc = CAN_ERR_DLC;
    return frame;
  });
  hal::SteadyClock clock;
  const auto link = drivers::MakeCanopenBender(
      ObjectMap(PlainMap()),
      {.interface = "vcan0", .node_id = 9, .response_timeout = std::chrono::minutes(5)}, clock);
  const auto state = link->ReadState();
  ASSERT_FALSE(state);
  EXPECT_NE(state.error().message.find("went off the bus"), std::string::npos)
      << state.error().message;
}

TEST(CanBus, AnInterfaceThatGoesDownComesBack) {
  CanopenBenderUnderTest cell(ObjectMap(PlainMap()), "vcan0");
  ASSERT_TRUE(cell.link().ReadState());
  ASSERT_EQ(std::system("ip link set vcan0 down"), 0);
  const auto down = cell.link().ReadState();
  ASSERT_FALSE(down);
  EXPECT_NE(down.error().message.find("is down"), std::string::npos) << down.error().message;
  ASSERT_EQ(std::system("ip link set vcan0 up"), 0);
  hal::SteadyClock clock;
  const auto deadline = clock.Now() + std::chrono::seconds(20);
  auto state = cell.link().ReadState();
  while (!state && clock.Now() < deadline) state = cell.link().ReadState();
  EXPECT_TRUE(state) << state.error().message;
}

TEST(CanBus, SaysWhatIsWrong) {
  hal::SteadyClock clock;
  auto link = drivers::MakeIsotpBender(PlainMap(), {.channel = {.interface = "nocan7"}});
  const auto missing = link->ReadState();
  ASSERT_FALSE(missing);
  EXPECT_NE(missing.error().message.find("none of that name"), std::string::npos)
      << missing.error().message;

  // Nobody is there: no flow control, no answer.
  link = drivers::MakeIsotpBender(PlainMap(), {.channel = Channel()});
  const auto silent = link->ReadState();
  ASSERT_FALSE(silent);
  EXPECT_EQ(silent.error().kind, hal::ErrorKind::kDevice);

  auto channel = Channel();
  channel.interface = "vcan1";  // exists, but is down
  link = drivers::MakeIsotpBender(PlainMap(), {.channel = channel});
  const auto down = link->ReadState();
  ASSERT_FALSE(down);
  EXPECT_NE(down.error().message.find("is down"), std::string::npos) << down.error().message;

  const auto read = [&](const std::string& interface) {
    const auto state = drivers::MakeCanopenBender(ObjectMap(PlainMap()),
                                                  {.interface = interface, .node_id = 9}, clock)
                           ->ReadState();
    return state ? "" : state.error().message;
  };
  EXPECT_EQ(read("nocan7"),
            "bender nocan7 node 9: CAN interface nocan7: there is none of that name (ip link show "
            "type can)");
  EXPECT_NE(read("vcan1").find("is down"), std::string::npos);
  EXPECT_EQ(read("vcan0"), "bender vcan0 node 9: read 2000sub1: no answer within 500 ms");
}

}  // namespace
}  // namespace bendloop::test
