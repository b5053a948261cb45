// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "drivers/modbus_bender/modbus_bender.h"
#include "drivers/register_bender/register_bender.h"
#include "hal/clock.h"

namespace bendloop::drivers {

// Modbus RTU on options.serial, by libmodbus's own calls: they compare crc, unit, function and
// length of an answer. RTU numbers no transactions: after an exchange that failed the line is
// listened to until it has been given up for one more response timeout, and what comes is thrown
// away.
std::unique_ptr<RegisterCarrier> MakeRtuCarrier(const hal::RegisterMap& map,
                                                const ModbusBenderOptions& options,
                                                hal::Clock& clock);

}  // namespace bendloop::drivers
