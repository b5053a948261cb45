// SPDX-License-Identifier: Apache-2.0
#include "drivers/modbus_bender/isotp_socket.h"

#include <linux/can.h>
#include <linux/can/isotp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>

#include "drivers/register_bender/can_interface.h"

namespace bendloop::drivers {
namespace {

// Above 11 bits it is an extended identifier.
canid_t Identifier(std::uint32_t id) { return id > CAN_SFF_MASK ? id | CAN_EFF_FLAG : id; }

}  // namespace

hal::Result<int> OpenIsotpSocket(const std::string& interface, std::uint32_t send_id,
                                 std::uint32_t receive_id) {
  const auto fail = [&](const std::string& what) {
    return hal::Fail(CanInterfaceError(interface, what));
  };
  const auto index = CanInterfaceIndex(interface);
  if (!index) return hal::Fail(index.error());
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = *index;
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
