// SPDX-License-Identifier: Apache-2.0
#include "drivers/can_socket/can_socket.h"

#include <fcntl.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/isotp.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <functional>

namespace bendloop::drivers {
namespace {

struct SocketKind {
  int type;
  int protocol;
  const char* name;
  const char* module;  // of the kernel
};
constexpr SocketKind kRaw{SOCK_RAW, CAN_RAW, "CAN", "can-raw"};
constexpr SocketKind kIsotp{SOCK_DGRAM, CAN_ISOTP, "ISO-TP", "can-isotp"};

// Opens, sets up (which may fail with errno) and binds.
hal::Result<int> Open(const SocketKind& kind, const std::string& interface, sockaddr_can address,
                      const std::function<bool(int socket_fd)>& set_up) {
  const auto fail = [&](const std::string& what) {
    return hal::Fail(hal::ErrorKind::kDevice, "CAN interface " + interface + ": " + what);
  };
  const unsigned index = if_nametoindex(interface.c_str());
  if (index == 0) return fail("there is none of that name (ip link show type can)");
  address.can_family = AF_CAN;
  address.can_ifindex = static_cast<int>(index);
  const int socket_fd = socket(PF_CAN, kind.type | SOCK_CLOEXEC, kind.protocol);
  if (socket_fd < 0) {
    return fail(std::string("no ") + kind.name + " sockets (modprobe " + kind.module +
                "): " + CanTrouble(errno));
  }
  if (!set_up(socket_fd) ||
      bind(socket_fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    const int error = errno;
    close(socket_fd);
    return fail(CanTrouble(error));
  }
  return socket_fd;
}

// Above 11 bits it is an extended identifier.
canid_t Identifier(std::uint32_t id) { return id > CAN_SFF_MASK ? id | CAN_EFF_FLAG : id; }

}  // namespace

hal::Result<int> OpenRawCanSocket(const std::string& interface,
                                  const std::vector<std::uint32_t>& ids) {
  std::vector<can_filter> filters;
  for (const std::uint32_t id : ids) {
    filters.push_back({id, CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG});
  }
  return Open(kRaw, interface, {}, [&](int socket_fd) {
    const can_err_mask_t errors = CAN_ERR_MASK;
    return setsockopt(socket_fd, SOL_CAN_RAW, CAN_RAW_FILTER, filters.data(),
                      static_cast<socklen_t>(filters.size() * sizeof filters[0])) == 0 &&
           setsockopt(socket_fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors) == 0;
  });
}

hal::Result<int> OpenIsotpSocket(const std::string& interface, std::uint32_t send_id,
                                 std::uint32_t receive_id) {
  sockaddr_can address{};
  address.can_addr.tp.tx_id = Identifier(send_id);
  address.can_addr.tp.rx_id = Identifier(receive_id);
  return Open(kIsotp, interface, address, [](int socket_fd) {
    can_isotp_options options{};
    options.flags = CAN_ISOTP_TX_PADDING;  // frames of 8 bytes, as many controllers want them
    options.txpad_content = CAN_ISOTP_DEFAULT_PAD_CONTENT;
    return setsockopt(socket_fd, SOL_CAN_ISOTP, CAN_ISOTP_OPTS, &options, sizeof options) == 0;
  });
}

hal::Result<int> CopySocket(int socket_fd) {
  const int copy = fcntl(socket_fd, F_DUPFD_CLOEXEC, 0);
  if (copy < 0) return hal::Fail(hal::ErrorKind::kDevice, std::strerror(errno));
  return copy;
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
