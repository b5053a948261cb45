// SPDX-License-Identifier: Apache-2.0
#include "drivers/isotp_bender/isotp_bender.h"

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <optional>
#include <utility>
#include <vector>

#include "drivers/can_socket/can_socket.h"
#include "drivers/modbus_bender/frame_carrier.h"

namespace bendloop::drivers {
namespace {

using Bytes = std::vector<std::uint8_t>;
using Clock = std::chrono::steady_clock;  // as poll() counts

class IsotpCarrier final : public FrameCarrier {
 public:
  IsotpCarrier(const hal::RegisterMap& map, IsotpBenderOptions options)
      : FrameCarrier(map, options.unit_id), options_(std::move(options)) {}
  ~IsotpCarrier() override { CloseSocket(); }
  IsotpCarrier(const IsotpCarrier&) = delete;
  IsotpCarrier& operator=(const IsotpCarrier&) = delete;

  std::string carrier() const override { return "Modbus on CAN"; }
  std::string peer() const override {
    const IsotpChannel& channel = options_.channel;
    char ids[32];
    std::snprintf(ids, sizeof ids, " 0x%x/0x%x", channel.request_id, channel.reply_id);
    return channel.interface + ids + " unit " + std::to_string(unit_id());
  }

  // Opening asks nobody, so there is nothing to wait for and nothing to back off from.
  hal::Result<void> Connect() override {
    if (socket_ >= 0) return {};
    const IsotpChannel& channel = options_.channel;
    const auto opened = channel.socket >= 0 ? CopySocket(channel.socket)
                                            : OpenIsotpSocket(channel.interface, channel.request_id,
                                                              channel.reply_id);
    if (!opened) {
      return hal::Fail(opened.error().kind, "bender " + peer() + ": " + opened.error().message);
    }
    socket_ = *opened;
    return {};
  }

 protected:
  int socket() const override { return socket_; }
  void Close() override { CloseSocket(); }

 private:
  static hal::Error Device(std::string message) {
    return {hal::ErrorKind::kDevice, std::move(message)};
  }

  void CloseSocket() {
    if (socket_ >= 0) close(socket_);
    socket_ = -1;
  }

  hal::Result<Bytes> Ask(const ModbusQuery& query) override {
    const Bytes& frame = query.frame();
    const ssize_t sent = send(socket_, frame.data(), frame.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent < 0) return hal::Fail(Device("cannot send: " + CanTrouble(errno)));
    if (sent != static_cast<ssize_t>(frame.size())) {
      return hal::Fail(Device("cannot send: the message does not go out whole"));
    }
    // Messages that answer another transaction are late: they are passed over, and returned only
    // if nothing better comes in time.
    const auto deadline = Clock::now() + options_.response_timeout;
    std::optional<Bytes> strange;
    for (;;) {
      auto message = Receive(deadline);
      if (!message) return hal::Fail(message.error());
      if (!*message) break;
      if (query.IsAnsweredBy(**message)) return std::move(**message);
      strange = std::move(**message);
    }
    if (strange) return std::move(*strange);
    return hal::Fail(Device("no complete answer within " +
                            std::to_string(options_.response_timeout.count()) + " ms"));
  }

  // The next message, which comes whole or not at all; none when the time is over.
  hal::Result<std::optional<Bytes>> Receive(Clock::time_point deadline) const {
    constexpr std::size_t kMaxFrame = 260;  // of Modbus TCP
    for (;;) {
      const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now());
      pollfd waiting{socket_, POLLIN, 0};
      if (left.count() <= 0 || poll(&waiting, 1, static_cast<int>(left.count())) <= 0) {
        return std::optional<Bytes>{};
      }
      Bytes message(kMaxFrame);
      const ssize_t size = recv(socket_, message.data(), message.size(), MSG_DONTWAIT);
      if (size < 0 && errno == EAGAIN) continue;
      if (size < 0) return hal::Fail(Device("no valid answer: " + CanTrouble(errno)));
      message.resize(static_cast<std::size_t>(size));
      return std::optional<Bytes>{std::move(message)};
    }
  }

  const IsotpBenderOptions options_;
  int socket_ = -1;
};

}  // namespace

std::unique_ptr<RegisterCarrier> MakeIsotpCarrier(const hal::RegisterMap& map,
                                                  IsotpBenderOptions options) {
  return std::make_unique<IsotpCarrier>(map, std::move(options));
}

std::unique_ptr<hal::BenderLink> MakeIsotpBender(hal::RegisterMap map, IsotpBenderOptions options) {
  auto carrier = MakeIsotpCarrier(map, std::move(options));
  return MakeRegisterBender(std::move(map), std::move(carrier));
}

}  // namespace bendloop::drivers
