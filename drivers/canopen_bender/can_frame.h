// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

namespace bendloop::drivers {

// One CAN frame as CANopen uses them: 11-bit identifier, up to 8 bytes.
struct CanFrame {
  enum class Kind : std::uint8_t { kData, kError };  // kError: the controller's own report

  Kind kind = Kind::kData;
  std::uint32_t id = 0;  // kError: the error class bits of linux/can/error.h
  std::uint8_t size = 0;
  std::array<std::uint8_t, 8> data{};

  bool operator==(const CanFrame&) const = default;
};

// Function codes of CiA 301's predefined connection set; the node id is added.
constexpr std::uint32_t kCobNmt = 0x000;  // without a node id
constexpr std::uint32_t kCobEmcy = 0x080;
constexpr std::uint32_t kCobSdoReply = 0x580;    // server to client
constexpr std::uint32_t kCobSdoRequest = 0x600;  // client to server
constexpr std::uint32_t kCobHeartbeat = 0x700;

constexpr std::uint8_t kMaxNodeId = 127;

}  // namespace bendloop::drivers
