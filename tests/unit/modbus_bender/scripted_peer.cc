// SPDX-License-Identifier: Apache-2.0
#include "tests/unit/modbus_bender/scripted_peer.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pty.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <utility>

namespace bendloop::test {

ScriptedPeer::ScriptedPeer(Carrier carrier, Script script)
    : carrier_(carrier), script_(std::move(script)), stop_(eventfd(0, EFD_CLOEXEC)) {
  if (carrier_ == Carrier::kRtu) {
    termios raw{};
    cfmakeraw(&raw);
    char name[64] = "";
    EXPECT_EQ(openpty(&line_, &far_line_, name, &raw, nullptr), 0);
    device_ = name;
  } else {
    listener_ = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    EXPECT_EQ(bind(listener_, reinterpret_cast<sockaddr*>(&address), size), 0);
    EXPECT_EQ(listen(listener_, 8), 0);
    EXPECT_EQ(getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size), 0);
    port_ = ntohs(address.sin_port);
  }
  thread_ = std::thread([this] { Serve(); });
}

ScriptedPeer::~ScriptedPeer() {
  EXPECT_EQ(eventfd_write(stop_, 1), 0);
  thread_.join();
  for (const int open : {listener_, line_, far_line_, stop_}) {
    if (open >= 0) close(open);
  }
}

void ScriptedPeer::Serve() {
  int client = line_;
  for (;;) {
    pollfd waiting[] = {{stop_, POLLIN, 0}, {listener_, POLLIN, 0}, {client, POLLIN, 0}};
    if (poll(waiting, 3, -1) <= 0) continue;
    if (waiting[0].revents != 0) break;
    if (waiting[2].revents != 0 && !Answer(client) && client != line_) {
      close(client);
      client = -1;
    }
    if (waiting[1].revents != 0) {
      if (client >= 0) close(client);
      client = accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
      const int on = 1;
      setsockopt(client, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
      ++connections_;
    }
  }
  if (client >= 0 && client != line_) close(client);
}

Bytes ScriptedPeer::Request(int client) const {
  const std::size_t header = carrier_ == Carrier::kTcp ? 7 : 1;
  Bytes request;
  std::size_t wanted = header + 5;  // function 3, 4 and 6
  while (request.size() < wanted) {
    std::uint8_t byte = 0;
    if (read(client, &byte, 1) != 1) return {};
    request.push_back(byte);
    if (request.size() == header + 1 && byte == 0x10) wanted += 1;
    if (request.size() == header + 6) wanted += byte;
  }
  if (carrier_ == Carrier::kRtu) {
    std::uint8_t crc[2];
    for (std::uint8_t& byte : crc) {
      if (read(client, &byte, 1) != 1) return {};
    }
  }
  return request;
}

bool ScriptedPeer::Answer(int client) {
  const Bytes request = Request(client);
  if (request.empty()) return false;
  ++requests_;
  const ScriptedAnswer answer = script_(request);
  const std::size_t piece = answer.byte_by_byte ? 1 : answer.bytes.size();
  for (std::size_t at = 0; at < answer.bytes.size(); at += piece) {
    if (write(client, answer.bytes.data() + at, piece) != static_cast<ssize_t>(piece)) return false;
  }
  return !answer.then_hangs_up;
}

Bytes GoodAnswer(const Bytes& request, std::size_t header) {
  Bytes answer(request.begin(), request.begin() + static_cast<std::ptrdiff_t>(header) + 1);
  const std::uint8_t function = request[header];
  if (function == 3 || function == 4) {
    const int first = request[header + 1] << 8 | request[header + 2];
    const int count = request[header + 3] << 8 | request[header + 4];
    answer.push_back(static_cast<std::uint8_t>(2 * count));
    for (int i = first; i < first + count; ++i) {
      answer.push_back(static_cast<std::uint8_t>(i >> 8));
      answer.push_back(static_cast<std::uint8_t>(i));
    }
  } else {
    answer.insert(answer.end(), request.begin() + static_cast<std::ptrdiff_t>(header) + 1,
                  request.begin() + static_cast<std::ptrdiff_t>(header) + 5);
  }
  if (header == 7) {
    answer[4] = 0;
    answer[5] = static_cast<std::uint8_t>(answer.size() - 6);
  }
  return answer;
}

Bytes WithCrc(Bytes frame) {
  std::uint16_t crc = 0xffff;
  for (const std::uint8_t byte : frame) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) {
      crc = static_cast<std::uint16_t>(crc & 1 ? crc >> 1 ^ 0xa001 : crc >> 1);
    }
  }
  frame.push_back(static_cast<std::uint8_t>(crc));
  frame.push_back(static_cast<std::uint8_t>(crc >> 8));
  return frame;
}

}  // namespace bendloop::test
