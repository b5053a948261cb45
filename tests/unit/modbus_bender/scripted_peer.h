// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <thread>
#include <vector>

namespace bendloop::test {

using Bytes = std::vector<std::uint8_t>;

// What goes back, and how.
struct ScriptedAnswer {
  Bytes bytes;
  bool byte_by_byte = false;
  bool then_hangs_up = false;
};

// A Modbus server that answers each request with whatever its script says, over TCP on 127.0.0.1 or
// over one end of a pseudo-terminal.
class ScriptedPeer {
 public:
  using Script = std::function<ScriptedAnswer(const Bytes& request)>;
  enum class Carrier { kTcp, kRtu };

  ScriptedPeer(Carrier carrier, Script script);
  ~ScriptedPeer();

  std::uint16_t port() const { return port_; }
  const std::string& device() const { return device_; }
  int requests() const { return requests_; }
  int connections() const { return connections_; }

 private:
  void Serve();
  bool Answer(int client);  // false: the client is to be hung up
  Bytes Request(int client) const;

  const Carrier carrier_;
  const Script script_;
  int listener_ = -1;
  int line_ = -1;
  int far_line_ = -1;
  int stop_ = -1;
  std::uint16_t port_ = 0;
  std::string device_;
  std::atomic<int> requests_{0};
  std::atomic<int> connections_{0};
  std::thread thread_;
};

// The good answer to a request for registers: register a holds a. `header` is 7 over TCP, 1 on RTU
// (whose crc is left out on both sides).
Bytes GoodAnswer(const Bytes& request, std::size_t header);

// With Modbus RTU's crc.
Bytes WithCrc(Bytes frame);

}  // namespace bendloop::test
