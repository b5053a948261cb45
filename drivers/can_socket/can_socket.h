// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "hal/result.h"

namespace bendloop::drivers {

// A raw socket on a CAN interface that gets the frames with these 11-bit identifiers, the kernel
// keeping all others away, and the controller's error frames. The caller closes it. kDevice in
// words if this kernel, interface or user cannot.
hal::Result<int> OpenRawCanSocket(const std::string& interface,
                                  const std::vector<std::uint32_t>& ids);

// One that sends ISO-TP messages with CAN identifier `send_id` and receives those with
// `receive_id`; above 0x7ff they are extended ones.
hal::Result<int> OpenIsotpSocket(const std::string& interface, std::uint32_t send_id,
                                 std::uint32_t receive_id);

// Another descriptor of a socket that is there.
hal::Result<int> CopySocket(int socket_fd);

// What errno means on a CAN socket, raw or ISO-TP, for the setter.
std::string CanTrouble(int error);

}  // namespace bendloop::drivers
