// SPDX-License-Identifier: Apache-2.0
#include "drivers/modbus_bender/isotp_socket.h"

#include <linux/can.h>
#include <linux/can/isotp.h>
#include <net/if.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace bendloop::drivers {
namespace {

// Above 11 bits it is an extended identifier.
canid_t Identifier(std::uint32_t id) { return id > CAN_SFF_MASK ? id | CAN_EFF_FLAG : id; }

}  // namespace

std::string CanTrouble(int error) {
  switch (error) {
    case ENETDOWN:
      return "the CAN interface is down (ip link set can0 up), or off the bus";
    case ENOBUFS:
      return "the CAN interface's transmit queue is full: nobody acknowledges on the bus";
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

hal::Result<int> OpenIsotpSocket(const std::string& interface, std::uint32_t send_id,
                                 std::uint32_t receive_id) {
  const auto fail = [&](const std::string& what) {
    return hal::Fail(hal::ErrorKind::kDevice, "CAN interface " + interface + ": " + what);
  };
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = static_cast<int>(if_nametoindex(interface.c_str()));
  if (address.can_ifindex == 0) return fail("there is none of that name (ip link show type can)");
  address.can_addr.tp.tx_id = Identifier(send_id);
  address.can_addr.tp.rx_id = Identifier(receive_id);
  const int socket_fd = socket(PF_CAN, SOCK_DGRAM | SOCK_CLOEXEC, CAN_ISOTP);
  if (socket_fd < 0) {
    return fail(std::string("no ISO-TP sockets (modprobe can-isotp): ") + std::strerror(errno));
  }
  can_isotp_options options{};
  options.flags = CAN_ISOTP_TX_PADDING;  // frames of 8 bytes, as many controllers want them
  options.txpad_content = CAN_ISOTP_DEFAULT_PAD_CONTENT;
  if (setsockopt(socket_fd, SOL_CAN_ISOTP, CAN_ISOTP_OPTS, &options, sizeof options) != 0 ||
      bind(socket_fd, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) {
    const int error = errno;
    close(socket_fd);
    return fail(CanTrouble(error));
  }
  return socket_fd;
}

}  // namespace bendloop::drivers
