// SPDX-License-Identifier: Apache-2.0
#include "drivers/modbus_bender/modbus_bender.h"

#include <utility>

#include "drivers/modbus_bender/rtu_carrier.h"
#include "drivers/modbus_bender/tcp_carrier.h"
#include "drivers/register_bender/register_bender.h"

namespace bendloop::drivers {

std::unique_ptr<RegisterCarrier> MakeModbusCarrier(const hal::RegisterMap& map,
                                                   const ModbusBenderOptions& options,
                                                   hal::Clock& clock) {
  return options.serial ? MakeRtuCarrier(map, options, clock) : MakeTcpCarrier(map, options, clock);
}

std::unique_ptr<hal::BenderLink> MakeModbusBender(hal::RegisterMap map, ModbusBenderOptions options,
                                                  hal::Clock& clock) {
  auto carrier = MakeModbusCarrier(map, options, clock);
  return MakeRegisterBender(std::move(map), std::move(carrier));
}

}  // namespace bendloop::drivers
