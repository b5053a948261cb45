// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

#include "drivers/canopen_bender/can_frame.h"

namespace bendloop::drivers {

// What a node tells without being asked: heartbeat with NMT state, boot-up, emergencies; and what
// our own CAN controller tells of the bus. Frames in, words out; no socket, no clock.
class NodeWatch {
 public:
  using Time = std::chrono::nanoseconds;

  // A node whose heartbeat was seen once and then stays away for longer than `timeout` is lost;
  // 0: it never is.
  NodeWatch(std::uint8_t node_id, std::chrono::milliseconds timeout)
      : node_id_(node_id), timeout_(timeout) {}

  // Takes heartbeats, emergencies and error frames; passes over others.
  void Receive(const CanFrame& frame, Time now);
  // Everything that came until now was taken. `without_pause`: since the last such call somebody
  // has been listening; else, if that was longer ago than the timeout, the time begins anew: what
  // was not listened to was not missed.
  void Listened(Time now, bool without_pause);

  bool lost(Time now) const;
  std::uint32_t heartbeats() const { return heartbeats_; }
  bool has_heartbeat() const { return last_heartbeat_.has_value(); }
  // The node's emergency error code; 0: none, or reset.
  std::uint16_t emergency() const { return emergency_; }
  // The node has restarted since this was asked last.
  bool TakeRestart();
  // The bus has failed in a way that ends a transfer; in words, and told once.
  std::optional<std::string> TakeBusFailure();
  // All that may explain why an answer stays away: "; its heartbeat says stopped; ...", or empty.
  std::string Remarks(Time now) const;

 private:
  void TakeBusReport(const CanFrame& frame);

  std::uint8_t node_id_;
  Time timeout_;
  std::optional<Time> last_heartbeat_;
  std::optional<Time> listened_;
  std::optional<std::uint8_t> nmt_state_;
  std::uint32_t heartbeats_ = 0;
  std::uint16_t emergency_ = 0;
  std::uint8_t error_register_ = 0;
  bool restarted_ = false;
  std::optional<std::string> bus_failure_;
  std::string bus_remark_;
};

// "operational"; "state 0x2a" for what CiA 301 does not name.
std::string NmtStateText(std::uint8_t state);
// "0x8130, heartbeat or node guarding error".
std::string EmergencyText(std::uint16_t code);

}  // namespace bendloop::drivers
