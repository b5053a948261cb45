// SPDX-License-Identifier: Apache-2.0
//
// The simulated bender answers each Modbus request, frame by frame: with an exception what it does
// not do, and never with silence.
#include <arpa/inet.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <string>
#include <vector>

#include "drivers/simulated_bender/modbus_framing.h"
#include "tests/support/modbus_bender_under_test.h"

namespace bendloop::drivers {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::uint8_t kUnit = 1;

// Bytes that come until there are `count`, or 5 s have passed.
Bytes Receive(int from, std::size_t count) {
  Bytes bytes;
  while (bytes.size() < count) {
    pollfd polled{from, POLLIN, 0};
    std::uint8_t byte = 0;
    if (poll(&polled, 1, 5000) <= 0 || read(from, &byte, 1) != 1) break;
    bytes.push_back(byte);
  }
  return bytes;
}

// Function and data, as each carrier sends them, and what comes back without its header and crc.
class Wire {
 public:
  explicit Wire(bool rtu)
      : rtu_(rtu),
        bender_(test::StartBender(test::SimulatorOptions(test::PlainMap(), rtu))),
        socket_(rtu ? open(bender_->device().c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC)
                    : Connect(bender_->port())) {}
  ~Wire() { close(socket_); }
  Wire(const Wire&) = delete;
  Wire& operator=(const Wire&) = delete;

  void Send(const Bytes& frame) {
    ASSERT_EQ(write(socket_, frame.data(), frame.size()), static_cast<ssize_t>(frame.size()));
  }
  Bytes Frame(const Bytes& request) const {
    Bytes frame;
    if (!rtu_) {
      const auto length = static_cast<std::uint8_t>(request.size() + 1);
      frame = {0x12, 0x34, 0, 0, static_cast<std::uint8_t>((request.size() + 1) >> 8), length};
    }
    frame.push_back(kUnit);
    frame.insert(frame.end(), request.begin(), request.end());
    if (rtu_) {
      const std::uint16_t crc = RtuCrc(frame.data(), frame.size());
      frame.push_back(static_cast<std::uint8_t>(crc));
      frame.push_back(static_cast<std::uint8_t>(crc >> 8));
    }
    return frame;
  }
  Bytes Ask(const Bytes& request, std::size_t answer) {
    Send(Frame(request));
    const std::size_t header = rtu_ ? 1 : 7;
    Bytes bytes = Receive(socket_, header + answer + (rtu_ ? 2 : 0));
    if (bytes.size() < header + answer) return {};
    return {bytes.begin() + static_cast<std::ptrdiff_t>(header),
            bytes.begin() + static_cast<std::ptrdiff_t>(header + answer)};
  }
  // It is there, and in step with us.
  bool Lives() { return Ask({0x03, 0, 0, 0, 1}, 4) == Bytes{0x03, 2, 0, 1}; }

 private:
  static int Connect(std::uint16_t port) {
    const int made = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(connect(made, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    return made;
  }

  bool rtu_;
  std::unique_ptr<SimulatedBender> bender_;
  int socket_;
};

class ModbusFunctions : public testing::TestWithParam<bool> {};

TEST_P(ModbusFunctions, WhatItDoesNotDoIsAnIllegalFunction) {
  Wire wire(GetParam());
  const Bytes requests[] = {{0x01, 0, 0, 0, 1},
                            {0x02, 0, 0, 0, 1},
                            {0x05, 0, 0, 0xff, 0},
                            {0x07},
                            {0x08, 0, 0, 0xa5, 0x37},
                            {0x0b},
                            {0x0f, 0, 0, 0, 4, 1, 0x0f},
                            {0x11},
                            {0x14, 7, 6, 0, 4, 0, 1, 0, 2},
                            {0x16, 0x03, 0xe8, 0, 0xf2, 0, 0x25},
                            {0x17, 0, 0, 0, 1, 0x03, 0xe8, 0, 1, 2, 0, 7},
                            {0x18, 0, 0},
                            {0x2b, 0x0e, 0x01, 0},
                            {0x64, 1, 2, 3, 4, 5, 6, 7, 8, 9}};
  for (const Bytes& request : requests) {
    const auto function = static_cast<std::uint8_t>(request[0] | 0x80);
    EXPECT_EQ(wire.Ask(request, 2), (Bytes{function, 1})) << "function " << int{request[0]};
    EXPECT_TRUE(wire.Lives()) << "after function " << int{request[0]};
  }
}

TEST_P(ModbusFunctions, WrongCountsAreIllegalValues) {
  Wire wire(GetParam());
  for (const std::uint8_t function : {0x03, 0x04}) {
    for (const std::uint8_t count : {0, 126, 255}) {
      EXPECT_EQ(wire.Ask({function, 0, 0, 0, count}, 2),
                (Bytes{static_cast<std::uint8_t>(function | 0x80), 3}))
          << int{function} << " " << int{count};
    }
  }
  for (const std::uint8_t count : {124, 126}) {
    Bytes request{0x10, 0x03, 0xe8, 0, count, static_cast<std::uint8_t>(2 * count)};
    request.resize(request.size() + 2u * count);
    EXPECT_EQ(wire.Ask(request, 2), (Bytes{0x90, 3})) << int{count};
  }
  // Count and bytes that do not go together.
  EXPECT_EQ(wire.Ask({0x10, 0x03, 0xe8, 0, 2, 2, 0, 7}, 2), (Bytes{0x90, 3}));
  EXPECT_TRUE(wire.Lives());
}

TEST_P(ModbusFunctions, RegistersThatDoNotExistAreIllegalAddresses) {
  Wire wire(GetParam());
  EXPECT_EQ(wire.Ask({0x03, 0x40, 0, 0, 1}, 2), (Bytes{0x83, 2}));
  EXPECT_EQ(wire.Ask({0x03, 0xff, 0xff, 0, 2}, 2), (Bytes{0x83, 2}));
  EXPECT_EQ(wire.Ask({0x06, 0, 0, 0, 7}, 2), (Bytes{0x86, 2})) << "the mode is the bender's";
  EXPECT_TRUE(wire.Lives());
}

INSTANTIATE_TEST_SUITE_P(Carriers, ModbusFunctions, testing::Bool(),
                         [](const auto& rtu) { return std::string(rtu.param ? "Rtu" : "Tcp"); });

// A frame for another unit, and one whose crc is wrong, are nobody's business.
TEST(ModbusLine, IsSilentToOthers) {
  Wire wire(true);
  Bytes other = wire.Frame({0x03, 0, 0, 0, 1});
  other[0] = kUnit + 1;
  const std::uint16_t crc = RtuCrc(other.data(), other.size() - 2);
  other[other.size() - 2] = static_cast<std::uint8_t>(crc);
  other[other.size() - 1] = static_cast<std::uint8_t>(crc >> 8);
  wire.Send(other);
  EXPECT_TRUE(wire.Lives()) << "the only answer is to this one";
}

}  // namespace
}  // namespace bendloop::drivers
