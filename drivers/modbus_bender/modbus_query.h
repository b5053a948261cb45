// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "drivers/register_bender/register_image.h"
#include "hal/result.h"

namespace bendloop::drivers {

std::uint8_t ReadFunction(const RegisterRange& range);   // 3 or 4
std::uint8_t WriteFunction(const RegisterRange& range);  // 6 or 16

// One request as a Modbus TCP frame (transaction, protocol 0, length, unit, function, data), and
// what must be true of its answer. Modbus TCP sends such frames, and so does Modbus on ISO-TP.
//
// libmodbus makes such frames, too, but its calls keep the answer to themselves, and 3.1.6 does not
// compare its unit, its length field or the address and value of an echo with the request's
// (tests/unit/modbus_bender/answer_test.cc holds that).
class ModbusQuery {
 public:
  ModbusQuery(std::uint16_t transaction, std::uint8_t unit, const RegisterRange& read);
  ModbusQuery(std::uint16_t transaction, std::uint8_t unit, const RegisterRange& write,
              const std::uint16_t* from);

  const std::vector<std::uint8_t>& frame() const { return frame_; }
  std::uint16_t transaction() const;

  // Is the frame numbered as an answer to this? Any other is late.
  bool IsAnsweredBy(std::span<const std::uint8_t> answer) const;
  // Takes the registers out of a good answer to a read; in words what is wrong with any other.
  hal::Result<void> TakeRead(std::span<const std::uint8_t> answer, std::uint16_t* to) const;
  // Is this the echo of the write?
  hal::Result<void> CheckEcho(std::span<const std::uint8_t> answer) const;

 private:
  void Begin(std::uint16_t transaction, std::uint8_t unit, std::uint8_t function,
             const RegisterRange& range);
  void End();
  std::span<const std::uint8_t> Request() const;  // function and data
  // The function and data of a frame that answers this.
  hal::Result<std::span<const std::uint8_t>> Open(std::span<const std::uint8_t> answer) const;

  std::vector<std::uint8_t> frame_;
  std::uint32_t count_;  // registers
};

}  // namespace bendloop::drivers
