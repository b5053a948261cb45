// SPDX-License-Identifier: Apache-2.0
#include "drivers/canopen_bender/can_port.h"

#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

#include "drivers/register_bender/can_interface.h"

namespace bendloop::drivers {
namespace {

class CanSocket final : public CanPort {
 public:
  explicit CanSocket(int socket) : socket_(socket) {}
  ~CanSocket() override { close(socket_); }

  hal::Result<bool> Send(const CanFrame& frame) override {
    can_frame raw{};
    raw.can_id = frame.id;
    raw.can_dlc = frame.size;
    std::copy(frame.data.begin(), frame.data.end(), raw.data);
    if (send(socket_, &raw, sizeof raw, MSG_DONTWAIT | MSG_NOSIGNAL) ==
        static_cast<ssize_t>(sizeof raw)) {
      return true;
    }
    if (errno == ENOBUFS || errno == EAGAIN || errno == EINTR) return false;
    return hal::Fail(hal::ErrorKind::kDevice, "cannot send: " + CanTrouble(errno));
  }

  hal::Result<std::optional<CanFrame>> Receive(std::chrono::milliseconds timeout) override {
    pollfd ready{socket_, POLLIN, 0};
    if (poll(&ready, 1, static_cast<int>(std::max<long>(timeout.count(), 0))) <= 0) {
      return std::optional<CanFrame>{};
    }
    can_frame raw{};
    const ssize_t size = recv(socket_, &raw, sizeof raw, MSG_DONTWAIT);
    if (size == 0) return hal::Fail(hal::ErrorKind::kDevice, "the CAN socket was closed");
    if (size < 0 && errno != EAGAIN && errno != EINTR) {
      return hal::Fail(hal::ErrorKind::kDevice, "cannot receive: " + CanTrouble(errno));
    }
    // Remote requests and CAN FD frames are not CANopen's.
    const bool error = raw.can_id & CAN_ERR_FLAG;
    if (size != static_cast<ssize_t>(sizeof raw) || raw.can_dlc > CAN_MAX_DLEN ||
        (!error && (raw.can_id & (CAN_EFF_FLAG | CAN_RTR_FLAG)) != 0)) {
      return std::optional<CanFrame>{};
    }
    CanFrame frame;
    frame.kind = error ? CanFrame::Kind::kError : CanFrame::Kind::kData;
    frame.id = raw.can_id & (error ? CAN_ERR_MASK : CAN_SFF_MASK);
    frame.size = raw.can_dlc;
    std::copy_n(raw.data, frame.data.size(), frame.data.begin());
    return std::optional<CanFrame>{frame};
  }

 private:
  int socket_;
};

bool SetUp(int socket_fd, const sockaddr_can& address, const std::vector<std::uint32_t>& ids) {
  std::vector<can_filter> filters;
  for (const std::uint32_t id : ids) {
    filters.push_back({id, CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG});
  }
  const can_err_mask_t errors = CAN_ERR_MASK;
  return setsockopt(socket_fd, SOL_CAN_RAW, CAN_RAW_FILTER, filters.data(),
                    static_cast<socklen_t>(filters.size() * sizeof filters[0])) == 0 &&
         setsockopt(socket_fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors) == 0 &&
         bind(socket_fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
}

}  // namespace

std::unique_ptr<CanPort> AdoptCanSocket(int socket) { return std::make_unique<CanSocket>(socket); }

hal::Result<std::unique_ptr<CanPort>> OpenCanPort(const std::string& interface,
                                                  const std::vector<std::uint32_t>& ids) {
  const auto fail = [&](const std::string& what) {
    return hal::Fail(CanInterfaceError(interface, what));
  };
  const auto index = CanInterfaceIndex(interface);
  if (!index) return hal::Fail(index.error());
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = *index;
  const int socket_fd = socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC, CAN_RAW);
  if (socket_fd < 0) return fail("no CAN sockets (modprobe can-raw): " + CanTrouble(errno));
  if (!SetUp(socket_fd, address, ids)) {
    const int error = errno;
    close(socket_fd);
    return fail(CanTrouble(error));
  }
  return AdoptCanSocket(socket_fd);
}

}  // namespace bendloop::drivers
