// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "drivers/modbus_bender/modbus_carrier.h"
#include "drivers/modbus_bender/modbus_query.h"

namespace bendloop::drivers {

// Modbus in numbered frames: who derives brings a frame there and one back.
class FrameCarrier : public ModbusCarrier {
 public:
  using ModbusCarrier::ModbusCarrier;

 protected:
  // Sends the query and returns what came back in time; errors as ReadRange's.
  virtual hal::Result<std::vector<std::uint8_t>> Ask(const ModbusQuery& query) = 0;

  hal::Result<void> ReadRange(const RegisterRange& range, std::uint16_t* to) final {
    const ModbusQuery query(++transaction_, unit_id(), range);
    const auto answer = Ask(query);
    if (!answer) return hal::Fail(answer.error());
    return query.TakeRead(*answer, to);
  }

  hal::Result<void> WriteRange(const RegisterRange& range, const std::uint16_t* from) final {
    const ModbusQuery query(++transaction_, unit_id(), range, from);
    const auto answer = Ask(query);
    if (!answer) return hal::Fail(answer.error());
    return query.CheckEcho(*answer);
  }

 private:
  std::uint16_t transaction_ = 0;
};

}  // namespace bendloop::drivers
