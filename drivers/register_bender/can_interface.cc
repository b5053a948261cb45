// SPDX-License-Identifier: Apache-2.0
#include "drivers/register_bender/can_interface.h"

#include <net/if.h>

#include <cerrno>
#include <cstring>

namespace bendloop::drivers {

hal::Result<int> CanInterfaceIndex(const std::string& interface) {
  const unsigned index = if_nametoindex(interface.c_str());
  if (index != 0) return static_cast<int>(index);
  return hal::Fail(
      CanInterfaceError(interface, "there is none of that name (ip link show type can)"));
}

hal::Error CanInterfaceError(const std::string& interface, const std::string& what) {
  return {hal::ErrorKind::kDevice, "CAN interface " + interface + ": " + what};
}

std::string CanTrouble(int error) {
  switch (error) {
    case ENETDOWN:
      return "the CAN interface is down (ip link set can0 up), or off the bus";
    case ENOBUFS:
      return "the CAN interface's transmit queue is full: nobody acknowledges on the bus";
    case ENODEV:
    case ENXIO:
      return "the CAN interface is gone";
    case EPERM:
    case EACCES:
      return "this user may not use CAN sockets";
    case EAGAIN:
      return "the last message still is under way: nobody acknowledges on the bus";
    case ECOMM:
      return "the bender does not take the message (no flow control)";
    case EBADMSG:
    case EILSEQ:
      return "frames of the answer are missing or out of order";
    default:
      return std::strerror(error);
  }
}

}  // namespace bendloop::drivers
