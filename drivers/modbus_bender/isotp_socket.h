// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "drivers/modbus_bender/modbus_bender.h"
#include "hal/result.h"

namespace bendloop::drivers {

// A kernel socket that sends ISO-TP messages with CAN identifier `send_id` and receives those with
// `receive_id`; other traffic never reaches it. The caller closes it. kDevice in words if this
// kernel, interface or user cannot.
hal::Result<int> OpenIsotpSocket(const std::string& interface, std::uint32_t send_id,
                                 std::uint32_t receive_id);

}  // namespace bendloop::drivers
