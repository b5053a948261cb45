// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/canopen_bender/can_frame.h"
#include "hal/result.h"

namespace bendloop::drivers {

// A way onto a bus. Errors are kDevice; after one the port is of no more use.
class CanPort {
 public:
  virtual ~CanPort() = default;
  // False: the transmit queue is full; try again later.
  virtual hal::Result<bool> Send(const CanFrame& frame) = 0;
  // The next frame, or none within `timeout`.
  virtual hal::Result<std::optional<CanFrame>> Receive(std::chrono::milliseconds timeout) = 0;
};

// SocketCAN: a raw socket on `interface` that gets the frames with these 11-bit identifiers, the
// kernel keeping all others away, and the controller's error frames.
hal::Result<std::unique_ptr<CanPort>> OpenCanPort(const std::string& interface,
                                                  const std::vector<std::uint32_t>& ids);

// Any socket that carries struct can_frame whole, as a raw CAN socket does. Takes it over.
std::unique_ptr<CanPort> AdoptCanSocket(int socket);

}  // namespace bendloop::drivers
