// SPDX-License-Identifier: Apache-2.0
#include "drivers/modbus_bender/modbus_context.h"

#include <sys/select.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <utility>

#include "drivers/modbus_bender/modbus_carrier.h"

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;

constexpr std::chrono::milliseconds kFirstBackoff{100};

std::uint32_t WholeSeconds(std::chrono::milliseconds time) {
  return static_cast<std::uint32_t>(time.count() / 1000);
}
std::uint32_t Microseconds(std::chrono::milliseconds time) {
  return static_cast<std::uint32_t>(time.count() % 1000 * 1000);
}

}  // namespace

ModbusContext::ModbusContext(std::string peer, const ModbusBenderOptions& options,
                             hal::Clock& clock, Make make, Prepare prepare)
    : peer_(std::move(peer)),
      options_(options),
      clock_(clock),
      make_(std::move(make)),
      prepare_(std::move(prepare)) {}

void ModbusContext::Close() {
  if (connected_) modbus_close(handle_.get());
  connected_ = false;
}

hal::Result<void> ModbusContext::Connect() {
  if (connected_) return {};
  if (!handle_) {
    auto made = make_();
    if (!made) return hal::Fail(made.error());
    if (!*made) {
      return hal::Fail(ErrorKind::kInternal, std::string("libmodbus: ") + modbus_strerror(errno));
    }
    handle_ = std::move(*made);
  }
  const std::chrono::nanoseconds now = clock_.Now();
  if (failed_connects_ > 1 && now < next_connect_) {
    // In the words of the try before: who asks four times a second hears of one trouble.
    return hal::Fail(connect_problem_);
  }
  auto connected = TryConnect();
  connected_ = connected.has_value();
  if (connected_) {
    failed_connects_ = 0;
  } else {
    modbus_close(handle_.get());
    connect_problem_ = connected.error();
    ++failed_connects_;
    const int doublings = std::clamp(failed_connects_ - 2, 0, 16);
    next_connect_ = clock_.Now() + std::min<std::chrono::nanoseconds>(
                                       kFirstBackoff * (1 << doublings), options_.max_backoff);
  }
  return connected;
}

hal::Result<void> ModbusContext::TryConnect() {
  modbus_t* const context = handle_.get();
  // libmodbus bounds connecting by its response timeout.
  modbus_set_response_timeout(context, WholeSeconds(options_.connect_timeout),
                              Microseconds(options_.connect_timeout));
  if (modbus_connect(context) != 0) {
    const int error = errno;
    const std::string why =
        error == ETIMEDOUT || error == EINPROGRESS
            ? "no answer within " + std::to_string(options_.connect_timeout.count()) + " ms"
            : modbus_strerror(error);
    return hal::Fail(ErrorKind::kDevice, "bender " + peer_ + ": cannot connect: " + why);
  }
  if (modbus_get_socket(context) >= FD_SETSIZE) {  // libmodbus waits with select()
    return hal::Fail(ErrorKind::kInternal, "bender " + peer_ + ": too many open files");
  }
  modbus_set_response_timeout(context, WholeSeconds(options_.response_timeout),
                              Microseconds(options_.response_timeout));
  modbus_set_byte_timeout(context, WholeSeconds(options_.byte_timeout),
                          Microseconds(options_.byte_timeout));
  return prepare_();
}

std::string ModbusContext::Trouble(int error) const {
  if (error == ETIMEDOUT) {
    std::string why =
        "no complete answer within " + std::to_string(options_.response_timeout.count()) + " ms";
    if (options_.byte_timeout.count() > 0) {
      why += ", or none of its bytes for " + std::to_string(options_.byte_timeout.count()) + " ms";
    }
    return why;
  }
  if (error == ECONNRESET) return "the bender closed the connection";
  if (error > MODBUS_ENOBASE && error < EMBBADCRC) {
    return "the bender answers exception " + ModbusException(error - MODBUS_ENOBASE);
  }
  if (error == EMBBADSLAVE) return "answer from another unit";
  return std::string("no valid answer: ") + modbus_strerror(error);
}

}  // namespace bendloop::drivers
