// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "hal/error.h"
#include "hal/result.h"

namespace bendloop::drivers {

// The kernel's number of a CAN interface; kDevice if there is none of that name.
hal::Result<int> CanInterfaceIndex(const std::string& interface);

// "CAN interface can0: WHAT", kDevice.
hal::Error CanInterfaceError(const std::string& interface, const std::string& what);

// What errno means on a CAN socket, raw or ISO-TP, for the setter.
std::string CanTrouble(int error);

}  // namespace bendloop::drivers
