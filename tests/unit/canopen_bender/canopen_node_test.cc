// SPDX-License-Identifier: Apache-2.0
//
// A node on a bus in our hands, with a clock in our hands.
#include "drivers/canopen_bender/canopen_node.h"

#include <gmock/gmock.h>
#include <linux/can/error.h>

#include <deque>
#include <functional>
#include <utility>

#include "tests/support/sdo_store.h"

namespace bendloop::drivers {
namespace {

using ::testing::HasSubstr;
using Bytes = std::vector<std::uint8_t>;
using std::chrono::milliseconds;

constexpr std::uint8_t kNode = 5;
constexpr ObjectId kObject{0x2001, 3};

struct Bus {
  hal::ManualClock clock;
  test::SdoStore store;
  SdoServer server{store};
  std::deque<CanFrame> coming;      // what is received next
  std::deque<CanFrame> answers;     // of the server, kept back while it is late
  int full = 0;                     // so many sends find the queue full
  bool dead = false;                // the server does not answer
  bool late = false;                // its answers stay in `answers`
  bool broken = false;              // the socket fails
  std::function<void()> when_sent;  // what happens on the bus after our next frame
  int opened = 0;

  static CanFrame Frame(std::uint32_t id, Bytes bytes) {
    CanFrame frame{CanFrame::Kind::kData, id, static_cast<std::uint8_t>(bytes.size()), {}};
    std::copy(bytes.begin(), bytes.end(), frame.data.begin());
    return frame;
  }
  void Heartbeat(std::uint8_t state) { coming.push_back(Frame(kCobHeartbeat + kNode, {state})); }
};

class Port final : public CanPort {
 public:
  explicit Port(Bus& bus) : bus_(bus) {}
  hal::Result<bool> Send(const CanFrame& frame) override {
    if (bus_.full > 0) return --bus_.full, false;
    if (bus_.when_sent) std::exchange(bus_.when_sent, nullptr)();
    if (bus_.dead) return true;
    bus_.server.Receive(frame.data);
    for (SdoData answer{}; bus_.server.NextFrame(answer);) {
      (bus_.late ? bus_.answers : bus_.coming)
          .push_back({CanFrame::Kind::kData, kCobSdoReply + kNode, 8, answer});
    }
    return true;
  }
  hal::Result<std::optional<CanFrame>> Receive(milliseconds timeout) override {
    if (bus_.broken) return hal::Fail(hal::ErrorKind::kDevice, "cannot receive: it is down");
    if (bus_.coming.empty()) {
      bus_.clock.Advance(timeout);
      return std::optional<CanFrame>{};
    }
    const CanFrame frame = bus_.coming.front();
    bus_.coming.pop_front();
    return std::optional<CanFrame>{frame};
  }

 private:
  Bus& bus_;
};

class Node : public ::testing::Test {
 protected:
  std::string ErrorOfRead() {
    const auto bytes = node_.Upload(kObject, 4, false);
    EXPECT_FALSE(bytes);
    return bytes ? "" : bytes.error().message;
  }
  void ExpectReads(const Bytes& expected) {
    const auto bytes = node_.Upload(kObject, 4, false);
    ASSERT_TRUE(bytes) << bytes.error().message;
    EXPECT_EQ(*bytes, expected);
  }

  Bus bus_;
  CanopenNode node_{"can7 node 5",
                    kNode,
                    [this] {
                      ++bus_.opened;
                      return hal::Result<std::unique_ptr<CanPort>>(std::make_unique<Port>(bus_));
                    },
                    milliseconds(500),
                    milliseconds(2000),
                    bus_.clock};
  const Bytes value_{1, 2};
  void SetUp() override { bus_.store.objects[kObject] = value_; }
};

TEST_F(Node, LateAnswersAreNeverTakenForNewOnes) {
  bus_.late = true;
  EXPECT_EQ(ErrorOfRead(), "bender can7 node 5: read 2001sub3: no answer within 500 ms");
  bus_.late = false;
  bus_.store.objects[kObject] = {7, 7};
  bus_.coming = bus_.answers;  // the old value, now
  ExpectReads({7, 7});
  // Later still: after the node was asked for something else.
  bus_.dead = true;
  EXPECT_THAT(ErrorOfRead(), HasSubstr("no answer"));
  EXPECT_THAT(ErrorOfRead(), HasSubstr("to find the node again: no answer within 1000 ms"));
  bus_.dead = false;
  bus_.coming.push_back(Bus::Frame(kCobSdoReply + kNode, {0x43, 0, 0x10, 0, 9, 9, 9, 9}));
  bus_.coming.push_back(Bus::Frame(kCobSdoReply + kNode, {0x4b, 1, 0x20, 3, 9, 9, 0, 0}));
  ExpectReads({7, 7});
}

TEST_F(Node, AbortsAndForeignFramesDoNotStayInTheWay) {
  bus_.store.objects.erase(kObject);
  EXPECT_EQ(ErrorOfRead(),
            "bender can7 node 5: read 2001sub3: the bender aborts: 0x06020000, the object does not "
            "exist in the object dictionary");
  bus_.store.objects.clear();  // not even those that every node has
  EXPECT_THAT(ErrorOfRead(), HasSubstr("read 2001sub3: the bender aborts"));
  bus_.store.objects[kObject] = value_;
  for (int i = 0; i < 3000; ++i) bus_.coming.push_back(Bus::Frame(0x123, {1, 2, 3}));
  bus_.coming.push_back(Bus::Frame(kCobSdoReply + kNode + 1, Bytes(8, 0x80)));
  ExpectReads(value_);
}

TEST_F(Node, FullQueueWaitsThenIsNamed) {
  bus_.full = 20;
  ExpectReads(value_);
  bus_.full = 100000;
  EXPECT_EQ(ErrorOfRead(),
            "bender can7 node 5: read 2001sub3: the CAN interface's transmit queue stays full: "
            "nobody acknowledges on the bus (bit rate, wiring, the other node's power)");
  bus_.full = 0;
  ExpectReads(value_);
}

TEST_F(Node, BusOffAndRestartEndATransferAtOnce) {
  bus_.Heartbeat(0x00);  // before it: no harm
  bus_.coming.push_back({CanFrame::Kind::kError, CAN_ERR_BUSOFF, 8, {}});
  ExpectReads(value_);
  const auto before = bus_.clock.Now();
  bus_.late = true;
  bus_.when_sent = [&] { bus_.Heartbeat(0x00); };
  EXPECT_THAT(ErrorOfRead(), HasSubstr("the node restarted (boot-up message)"));
  bus_.late = false;
  bus_.when_sent = [&] { bus_.coming.push_back({CanFrame::Kind::kError, CAN_ERR_BUSOFF, 8, {}}); };
  EXPECT_THAT(ErrorOfRead(), HasSubstr("the CAN controller went off the bus"));
  EXPECT_LT(bus_.clock.Now() - before, milliseconds(100));
  ExpectReads(value_);
}

TEST_F(Node, HeartbeatTellsWhyNobodyAnswers) {
  bus_.Heartbeat(0x04);
  bus_.coming.push_back(Bus::Frame(kCobEmcy + kNode, {0x10, 0x81, 0x11, 0, 0, 0, 0, 0}));
  bus_.dead = true;
  EXPECT_EQ(ErrorOfRead(),
            "bender can7 node 5: read 2001sub3: no answer within 500 ms; its heartbeat says "
            "stopped, where it answers nothing until an NMT master starts it; it reports emergency "
            "0x8110, CAN overrun, frames lost (error register 0x11)");
  bus_.dead = false;
  bus_.Heartbeat(0x05);
  bus_.coming.push_back(Bus::Frame(kCobEmcy + kNode, {0, 0, 0, 0, 0, 0, 0, 0}));
  ExpectReads(value_);
  EXPECT_EQ(node_.watch().emergency(), 0);
  EXPECT_EQ(node_.watch().heartbeats(), 2u);
}

TEST_F(Node, HeartbeatThatStaysAwayIsALostNode) {
  bus_.Heartbeat(0x05);
  ExpectReads(value_);
  bus_.clock.Advance(std::chrono::minutes(10));  // nobody listened: nothing was missed
  ExpectReads(value_);
  for (int i = 0; i < 4; ++i) {
    bus_.clock.Advance(milliseconds(600));
    if (i < 3) ExpectReads(value_);
  }
  EXPECT_EQ(ErrorOfRead(),
            "bender can7 node 5: read 2001sub3: not asked; its heartbeat stays away for 2400 ms");
  bus_.Heartbeat(0x05);
  ExpectReads(value_);
}

TEST_F(Node, BrokenSocketIsOpenedAnew) {
  ExpectReads(value_);
  bus_.broken = true;
  EXPECT_EQ(ErrorOfRead(), "bender can7 node 5: read 2001sub3: cannot receive: it is down");
  bus_.broken = false;
  ExpectReads(value_);
  EXPECT_EQ(bus_.opened, 2);
}

TEST(NodeWatch, BusTroubleInWords) {
  NodeWatch watch(kNode, milliseconds(0));
  const auto report = [&](std::uint32_t id, std::uint8_t detail) {
    watch.Receive({CanFrame::Kind::kError, id, 8, {0, detail}}, {});
    return watch.Remarks({});
  };
  EXPECT_THAT(report(CAN_ERR_ACK, 0), HasSubstr("nobody on the bus acknowledges"));
  EXPECT_THAT(report(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE), HasSubstr("error passive"));
  EXPECT_THAT(report(CAN_ERR_CRTL, CAN_ERR_CRTL_RX_OVERFLOW), HasSubstr("lost received frames"));
  EXPECT_THAT(report(CAN_ERR_PROT | CAN_ERR_BUSERROR, 0), HasSubstr("bus errors"));
  EXPECT_EQ(report(CAN_ERR_RESTARTED, 0), "");
  EXPECT_FALSE(watch.TakeBusFailure());
  report(CAN_ERR_BUSOFF, 0);
  EXPECT_THAT(watch.TakeBusFailure().value_or(""), HasSubstr("went off the bus"));
  EXPECT_FALSE(watch.TakeBusFailure());
  EXPECT_EQ(NmtStateText(0x7f), "pre-operational");
  EXPECT_EQ(EmergencyText(0x3310), "0x3310, output voltage");
  EXPECT_EQ(EmergencyText(0x5530), "0x5530, device hardware");
}

}  // namespace
}  // namespace bendloop::drivers
