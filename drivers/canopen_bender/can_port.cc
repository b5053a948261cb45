// SPDX-License-Identifier: Apache-2.0
#include "drivers/canopen_bender/can_port.h"

#include <linux/can.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

#include "drivers/can_socket/can_socket.h"

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

}  // namespace

std::unique_ptr<CanPort> AdoptCanSocket(int socket) { return std::make_unique<CanSocket>(socket); }

hal::Result<std::unique_ptr<CanPort>> OpenCanPort(const std::string& interface,
                                                  const std::vector<std::uint32_t>& ids) {
  const auto opened = OpenRawCanSocket(interface, ids);
  if (!opened) return hal::Fail(opened.error());
  return AdoptCanSocket(*opened);
}

}  // namespace bendloop::drivers
