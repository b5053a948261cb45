// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

// The scanner's wire protocol in numbers; README.md beside this file is the reference.
namespace bendloop::drivers {

constexpr std::array<std::uint8_t, 4> kWireMagic = {'B', 'L', 'S', 'W'};
constexpr std::uint8_t kWireVersion = 1;
constexpr std::size_t kWireHeaderBytes = 20;  // with the header's own CRC
constexpr std::size_t kWireTrailerBytes = 4;  // CRC of the payload
constexpr std::size_t kWireMaxPoints = 16384;
constexpr std::size_t kWireProfileHeadBytes = 80;
constexpr std::size_t kWirePointBytes = 9;  // x, z, intensity
constexpr std::size_t kWireMaxPayload = kWireProfileHeadBytes + kWireMaxPoints * kWirePointBytes;
constexpr std::size_t kWireMaxMessage = kWireHeaderBytes + kWireMaxPayload + kWireTrailerBytes;
constexpr std::size_t kWireMaxText = 119;  // as hal::ScanEvent

// On USB: the interface that carries it.
constexpr std::uint8_t kWireUsbClass = 0xFF;  // vendor
constexpr std::uint8_t kWireUsbSubclass = 0x42;
constexpr std::uint8_t kWireUsbProtocol = kWireVersion;

enum class WireType : std::uint8_t {
  // Host to device.
  kIdentify = 0x01,
  kSettings = 0x02,
  kStart = 0x03,
  kStop = 0x04,
  // Device to host.
  kIdentity = 0x81,
  kReply = 0x82,
  kProfile = 0x90,
  kEvent = 0x91,
};

}  // namespace bendloop::drivers
