// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "drivers/scanner_wire/wire_format.h"
#include "hal/laser_profile.h"
#include "hal/scan_event.h"

namespace bendloop::drivers {

// Who the scanner is.
struct WireIdentity {
  std::string model;
  std::string serial;
  std::string firmware;
  std::string calibration;       // id of the factory calibration
  std::uint32_t max_points = 0;  // of one profile, at most kWireMaxPoints
};

// What the host asks of the scanner; 0 leaves a value as the device has it.
struct WireSettings {
  std::uint32_t profiles_per_second_milli = 0;  // 1000 is one profile a second
  std::uint32_t exposure_us = 0;
  bool intensity = true;
};

// The device's answer to settings, start and stop.
struct WireReply {
  WireType request = WireType::kStart;
  std::uint8_t status = 0;             // 0: done; anything else: refused
  std::uint32_t request_sequence = 0;  // message sequence of the request
  std::string text;                    // why refused
};

// From payload to value; false if the payload is not what README.md says (length, a number that is
// not finite, a pose that is not a rotation). Profile and event allocate nothing while the profile
// has the capacity.
[[nodiscard]] bool DecodeProfile(std::span<const std::uint8_t> payload, hal::LaserProfile& profile);
[[nodiscard]] bool DecodeEvent(std::span<const std::uint8_t> payload, hal::ScanEvent& event);
[[nodiscard]] bool DecodeIdentity(std::span<const std::uint8_t> payload, WireIdentity& identity);
[[nodiscard]] bool DecodeSettings(std::span<const std::uint8_t> payload, WireSettings& settings);
[[nodiscard]] bool DecodeReply(std::span<const std::uint8_t> payload, WireReply& reply);

// A coordinate as it is after a journey over the wire, which carries whole micrometres.
float RoundToWire(double coordinate_mm);

}  // namespace bendloop::drivers
