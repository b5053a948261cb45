// SPDX-License-Identifier: Apache-2.0
#include "drivers/modbus_bender/rtu_carrier.h"

#include <linux/serial.h>
#include <poll.h>
#include <sys/ioctl.h>

#include <cerrno>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

#include "drivers/modbus_bender/modbus_carrier.h"
#include "drivers/modbus_bender/modbus_context.h"

namespace bendloop::drivers {
namespace {

constexpr int kShortestFrame = 4;  // bytes; fewer are a line's noise when it switches its direction

class RtuCarrier final : public ModbusCarrier {
 public:
  RtuCarrier(const hal::RegisterMap& map, const ModbusBenderOptions& options, hal::Clock& clock)
      : ModbusCarrier(map, options.unit_id),
        line_(*options.serial),
        response_timeout_(options.response_timeout),
        clock_(clock),
        context_(
            peer(), options, clock, [this] { return MakeHandle(); },
            [this] { return PrepareLine(); }) {}

  std::string carrier() const override { return "Modbus RTU"; }
  std::string peer() const override { return line_.device + " unit " + std::to_string(unit_id()); }
  hal::Result<void> Connect() override { return context_.Connect(); }

 protected:
  int socket() const override { return context_.socket(); }
  // Bytes that wait now were not asked for by us: a second answer, or another master's question or
  // answer. What may still come after them could be taken for ours.
  void Close() override {
    int pending = 0;
    const int line = context_.socket();
    if (line >= 0 && ioctl(line, FIONREAD, &pending) == 0 && pending >= kShortestFrame) {
      quiet_at_ = clock_.Now() + response_timeout_;
    }
    context_.Close();
  }

  hal::Result<void> ReadRange(const RegisterRange& range, std::uint16_t* to) override {
    const auto read = range.space == hal::RegisterSpace::kHolding ? modbus_read_registers
                                                                  : modbus_read_input_registers;
    const auto count = static_cast<int>(range.count);
    return Outcome(read(context_.get(), static_cast<int>(range.address), count, to) == count);
  }

  hal::Result<void> WriteRange(const RegisterRange& range, const std::uint16_t* from) override {
    const auto address = static_cast<int>(range.address);
    const auto count = static_cast<int>(range.count);
    const int written = count == 1 ? modbus_write_register(context_.get(), address, *from)
                                   : modbus_write_registers(context_.get(), address, count, from);
    return Outcome(written == count);
  }

 private:
  hal::Result<ModbusHandle> MakeHandle() const {
    constexpr int kDataBits = 8;
    ModbusHandle handle(modbus_new_rtu(line_.device.c_str(), line_.baud,
                                       static_cast<char>(line_.parity), kDataBits,
                                       line_.stop_bits));
    if (handle && modbus_set_slave(handle.get(), unit_id()) != 0) {
      return hal::Fail(hal::ErrorKind::kBadInput, "bender unit " + std::to_string(unit_id()) +
                                                      ": 1 to 247 was expected for Modbus RTU");
    }
    return handle;
  }

  hal::Result<void> PrepareLine() {
    if (line_.rs485) {
      serial_rs485 mode{};
      mode.flags = SER_RS485_ENABLED | SER_RS485_RTS_ON_SEND;
      mode.delay_rts_before_send = static_cast<std::uint32_t>(line_.delay_before_send.count());
      mode.delay_rts_after_send = static_cast<std::uint32_t>(line_.delay_after_send.count());
      if (ioctl(modbus_get_socket(context_.get()), TIOCSRS485, &mode) != 0) {
        return hal::Fail(hal::ErrorKind::kDevice,
                         "bender " + peer() + ": the port cannot switch an RS-485 line (" +
                             modbus_strerror(errno) +
                             "); use a port that can, or one that switches by itself with rs485 "
                             "= false");
      }
    }
    ListenUntilQuiet();
    modbus_flush(context_.get());
    return {};
  }

  void ListenUntilQuiet() {
    if (!quiet_at_) return;
    pollfd line{modbus_get_socket(context_.get()), POLLIN, 0};
    for (;;) {
      const auto left = std::chrono::ceil<std::chrono::milliseconds>(*quiet_at_ - clock_.Now());
      if (left.count() <= 0 || poll(&line, 1, static_cast<int>(left.count())) <= 0) break;
      if (line.revents != POLLIN || modbus_flush(context_.get()) < 0) break;
    }
    quiet_at_.reset();
  }

  hal::Result<void> Outcome(bool good) {
    if (good) return {};
    const int error = errno;
    quiet_at_ = clock_.Now() + response_timeout_;
    return hal::Fail(hal::ErrorKind::kDevice, context_.Trouble(error));
  }

  const SerialLine line_;
  const std::chrono::milliseconds response_timeout_;
  hal::Clock& clock_;
  ModbusContext context_;
  std::optional<std::chrono::nanoseconds> quiet_at_;  // a late answer may come until then
};

}  // namespace

std::unique_ptr<RegisterCarrier> MakeRtuCarrier(const hal::RegisterMap& map,
                                                const ModbusBenderOptions& options,
                                                hal::Clock& clock) {
  return std::make_unique<RtuCarrier>(map, options, clock);
}

}  // namespace bendloop::drivers
