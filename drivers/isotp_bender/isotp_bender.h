// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include "drivers/register_bender/register_bender.h"
#include "hal/bender_link.h"
#include "hal/register_map.h"

namespace bendloop::drivers {

// A pair of CAN identifiers on which the bender takes and gives ISO-TP messages (ISO 15765-2). Each
// carries one Modbus TCP frame, header and all. Above 0x7ff an identifier is an extended one.
struct IsotpChannel {
  std::string interface;  // "can0", up and at the bus's bit rate
  std::uint32_t request_id = 0x7e0;
  std::uint32_t reply_id = 0x7e8;
  // Carries whole messages as datagrams, in place of the interface's; each side works on a copy of
  // its own end.
  int socket = -1;
};

struct IsotpBenderOptions {
  IsotpChannel channel;
  std::uint8_t unit_id = 1;
  std::chrono::milliseconds response_timeout{500};
};

// A bender behind Modbus on CAN; the controller's addresses and conventions come from `map`.
// drivers/README.md tells its side. Not thread-safe: one thread talks to one bender.
std::unique_ptr<hal::BenderLink> MakeIsotpBender(hal::RegisterMap map, IsotpBenderOptions options);

// Its registers alone.
std::unique_ptr<RegisterCarrier> MakeIsotpCarrier(const hal::RegisterMap& map,
                                                  IsotpBenderOptions options);

}  // namespace bendloop::drivers
