// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "drivers/scanner_wire/wire_messages.h"
#include "hal/result.h"

namespace bendloop::drivers {

// Turns values into messages, numbered one after the other; one encoder for each direction of a
// connection. Each call appends one whole message to `out`. Texts are cut at kWireMaxText bytes.
class WireEncoder {
 public:
  // kBadInput for a profile with too many points, an intensity without one value a point, or
  // coordinates that do not fit 32 bits of micrometres; nothing is appended then.
  hal::Result<void> Append(const hal::LaserProfile& profile, std::vector<std::uint8_t>& out);
  void Append(const hal::ScanEvent& event, std::vector<std::uint8_t>& out);
  void Append(const WireIdentity& identity, std::vector<std::uint8_t>& out);
  void Append(const WireSettings& settings, std::vector<std::uint8_t>& out);
  void Append(const WireReply& reply, std::vector<std::uint8_t>& out);
  // Any payload of at most kWireMaxPayload bytes; kIdentify, kStart and kStop have none.
  void Append(WireType type, std::span<const std::uint8_t> payload, std::vector<std::uint8_t>& out);

  // Sequence number of the next message.
  std::uint32_t sequence() const { return sequence_; }
  // Leaves numbers out, as if messages had been lost.
  void Skip(std::uint32_t messages) { sequence_ += messages; }

 private:
  std::uint32_t sequence_ = 0;
  std::vector<std::uint8_t> payload_;
};

}  // namespace bendloop::drivers
