// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "drivers/register_bender/register_bender.h"
#include "hal/bender_link.h"
#include "hal/clock.h"
#include "hal/register_map.h"

namespace bendloop::drivers {

enum class SerialParity : char { kNone = 'N', kEven = 'E', kOdd = 'O' };

// A serial port with the bender's Modbus RTU line on it.
struct SerialLine {
  std::string device;  // "/dev/ttyS1"
  int baud = 19200;    // one of the usual ones
  SerialParity parity = SerialParity::kEven;
  int stop_bits = 1;
  // The port's driver switches the direction of an RS-485 line by RTS, with these pauses around
  // each request. false: RS-232, or an adapter that switches by itself.
  bool rs485 = false;
  std::chrono::milliseconds delay_before_send{0};
  std::chrono::milliseconds delay_after_send{0};
};

struct ModbusBenderOptions {
  std::string host = "127.0.0.1";  // numeric address (looking up a name has no bounded time)
  std::uint16_t port = 502;
  std::optional<SerialLine> serial;  // Modbus RTU on this line instead of TCP
  std::uint8_t unit_id = 1;
  std::chrono::milliseconds connect_timeout{1000};
  std::chrono::milliseconds response_timeout{500};
  // Between two bytes of a reply; 0: the response timeout bounds the whole reply.
  std::chrono::milliseconds byte_timeout{0};
  // After the second failed connection in a row calls fail at once until the next try is due:
  // 100 ms, doubled up to this.
  std::chrono::milliseconds max_backoff{2000};
};

// A bender behind Modbus TCP or RTU; the PLC's addresses and conventions come from `map`.
// drivers/README.md tells the PLC programmer's side. Not thread-safe: one thread talks to one
// bender.
std::unique_ptr<hal::BenderLink> MakeModbusBender(hal::RegisterMap map, ModbusBenderOptions options,
                                                  hal::Clock& clock);

// Its registers alone.
std::unique_ptr<RegisterCarrier> MakeModbusCarrier(const hal::RegisterMap& map,
                                                   const ModbusBenderOptions& options,
                                                   hal::Clock& clock);

}  // namespace bendloop::drivers
