// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "drivers/register_bender/register_bender.h"
#include "drivers/register_bender/register_image.h"
#include "hal/register_map.h"
#include "hal/result.h"

namespace bendloop::drivers {

// Registers over Modbus, whatever brings a request there: one exchange of bounded time a range,
// never repeated by itself. One that fails closes the connection, so that a late answer can never
// be taken for a later one's; the next call connects again. Errors are kDevice and name peer,
// function and registers.
class ModbusCarrier : public RegisterCarrier {
 public:
  ModbusCarrier(const hal::RegisterMap& map, std::uint8_t unit_id)
      : unit_id_(unit_id), max_read_(map.max_read_registers), max_write_(map.max_write_registers) {}

  hal::Result<void> Read(const std::vector<RegisterRange>& ranges, RegisterImage& image) final;
  hal::Result<void> Write(const std::vector<RegisterRange>& ranges,
                          const RegisterImage& image) final;

 protected:
  std::uint8_t unit_id() const { return unit_id_; }

  virtual int socket() const = 0;  // -1 while not connected
  virtual void Close() = 0;        // also called when not connected
  // One exchange while connected; errors say what is wrong with the answer and no more.
  // Functions 3 and 4, at most 125 registers.
  virtual hal::Result<void> ReadRange(const RegisterRange& range, std::uint16_t* to) = 0;
  // Function 6 for one register, 16 for up to 123.
  virtual hal::Result<void> WriteRange(const RegisterRange& range, const std::uint16_t* from) = 0;

 private:
  hal::Result<void> Exchange(const std::string& what,
                             const std::function<hal::Result<void>()>& exchange);

  const std::uint8_t unit_id_;
  const std::uint16_t max_read_;
  const std::uint16_t max_write_;
};

// "illegal data address (2)", for the setter.
std::string ModbusException(int code);

}  // namespace bendloop::drivers
