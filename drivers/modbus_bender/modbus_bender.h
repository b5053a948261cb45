// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include "hal/bender_link.h"
#include "hal/clock.h"
#include "hal/register_map.h"

namespace bendloop::drivers {

struct ModbusBenderOptions {
  std::string host = "127.0.0.1";  // numeric address (looking up a name has no bounded time)
  std::uint16_t port = 502;
  std::uint8_t unit_id = 1;
  std::chrono::milliseconds connect_timeout{1000};
  std::chrono::milliseconds response_timeout{500};
  // Between two bytes of a reply; 0: the response timeout bounds the whole reply.
  std::chrono::milliseconds byte_timeout{0};
  // After the second failed connection in a row calls fail at once until the next try is due:
  // 100 ms, doubled up to this.
  std::chrono::milliseconds max_backoff{2000};
};

// A bender behind Modbus TCP; the PLC's addresses and conventions come from `map`.
// drivers/README.md tells the PLC programmer's side. Not thread-safe: one thread talks to one
// bender.
std::unique_ptr<hal::BenderLink> MakeModbusBender(hal::RegisterMap map, ModbusBenderOptions options,
                                                  hal::Clock& clock);

}  // namespace bendloop::drivers
