// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "drivers/modbus_bender/modbus_bender.h"
#include "drivers/register_bender/register_bender.h"
#include "hal/clock.h"

namespace bendloop::drivers {

// Modbus TCP: libmodbus connects, cuts the stream into answers and watches the time; requests are
// numbered and answers checked by ModbusQuery, which says why.
std::unique_ptr<RegisterCarrier> MakeTcpCarrier(const hal::RegisterMap& map,
                                                const ModbusBenderOptions& options,
                                                hal::Clock& clock);

}  // namespace bendloop::drivers
