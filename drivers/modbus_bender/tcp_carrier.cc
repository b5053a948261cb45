// SPDX-License-Identifier: Apache-2.0
#include "drivers/modbus_bender/tcp_carrier.h"

#include <sys/socket.h>

#include <cerrno>
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/modbus_bender/frame_carrier.h"
#include "drivers/modbus_bender/modbus_context.h"
#include "hal/network_address.h"

namespace bendloop::drivers {
namespace {

class TcpCarrier final : public FrameCarrier {
 public:
  TcpCarrier(const hal::RegisterMap& map, const ModbusBenderOptions& options, hal::Clock& clock)
      : FrameCarrier(map, options.unit_id),
        host_(options.host == "localhost" ? "127.0.0.1" : options.host),
        port_(std::to_string(options.port)),
        context_(
            peer(), options, clock, [this] { return MakeHandle(); },
            [] { return hal::Result<void>{}; }) {}

  std::string carrier() const override { return "Modbus TCP"; }
  std::string peer() const override {
    return host_ + ":" + port_ + " unit " + std::to_string(unit_id());
  }
  hal::Result<void> Connect() override { return context_.Connect(); }

 protected:
  int socket() const override { return context_.socket(); }
  void Close() override { context_.Close(); }

 private:
  hal::Result<ModbusHandle> MakeHandle() const {
    if (!hal::IsNumericAddress(host_)) {
      return hal::Fail(
          hal::ErrorKind::kBadInput,
          "bender host \"" + host_ + "\": a numeric address such as 192.168.0.10 was expected");
    }
    return ModbusHandle(modbus_new_tcp_pi(host_.c_str(), port_.c_str()));
  }

  hal::Result<std::vector<std::uint8_t>> Ask(const ModbusQuery& query) override {
    const auto fail = [](const std::string& what) {
      return hal::Fail(hal::ErrorKind::kDevice, what);
    };
    const auto& frame = query.frame();
    const ssize_t sent = send(socket(), frame.data(), frame.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent < 0) return fail(std::string("cannot send: ") + modbus_strerror(errno));
    if (sent != static_cast<ssize_t>(frame.size())) {
      return fail("cannot send: connection is stuck");
    }
    std::vector<std::uint8_t> answer(MODBUS_TCP_MAX_ADU_LENGTH);
    const int received = modbus_receive_confirmation(context_.get(), answer.data());
    if (received < 0) return fail(context_.Trouble(errno));
    answer.resize(static_cast<std::size_t>(received));
    return answer;
  }

  const std::string host_;
  const std::string port_;
  ModbusContext context_;
};

}  // namespace

std::unique_ptr<RegisterCarrier> MakeTcpCarrier(const hal::RegisterMap& map,
                                                const ModbusBenderOptions& options,
                                                hal::Clock& clock) {
  return std::make_unique<TcpCarrier>(map, options, clock);
}

}  // namespace bendloop::drivers
