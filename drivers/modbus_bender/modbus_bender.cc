// SPDX-License-Identifier: Apache-2.0
#include "drivers/modbus_bender/modbus_bender.h"

#include <utility>

#include "drivers/modbus_bender/rtu_carrier.h"
#include "drivers/modbus_bender/tcp_carrier.h"
#include "drivers/register_bender/register_bender.h"

namespace bendloop::drivers {

std::unique_ptr<hal::BenderLink> MakeModbusBender(hal::RegisterMap map, ModbusBenderOptions options,
                                                  hal::Clock& clock) {
  auto carrier =
      options.serial ? MakeRtuCarrier(map, options, clock) : MakeTcpCarrier(map, options, clock);
  return MakeRegisterBender(std::move(map), std::move(carrier));
}

}  // namespace bendloop::drivers
