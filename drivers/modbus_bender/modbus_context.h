// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <modbus/modbus.h>

#include <chrono>
#include <functional>
#include <memory>
#include <string>

#include "drivers/modbus_bender/modbus_bender.h"
#include "hal/clock.h"
#include "hal/result.h"

namespace bendloop::drivers {

struct FreeModbus {
  void operator()(modbus_t* context) const { modbus_free(context); }
};
using ModbusHandle = std::unique_ptr<modbus_t, FreeModbus>;

// libmodbus's context, connected in bounded time and not more often than the options want.
class ModbusContext {
 public:
  // `make`s the handle at the first connect; `prepare` is called after each that succeeded.
  using Make = std::function<hal::Result<ModbusHandle>()>;
  using Prepare = std::function<hal::Result<void>()>;
  ModbusContext(std::string peer, const ModbusBenderOptions& options, hal::Clock& clock, Make make,
                Prepare prepare);
  ~ModbusContext() { Close(); }
  ModbusContext(const ModbusContext&) = delete;
  ModbusContext& operator=(const ModbusContext&) = delete;

  // Does nothing when connected.
  hal::Result<void> Connect();
  void Close();
  modbus_t* get() const { return handle_.get(); }
  int socket() const { return connected_ ? modbus_get_socket(handle_.get()) : -1; }

  // Why one of libmodbus's calls failed with this errno, for the setter.
  std::string Trouble(int error) const;

 private:
  hal::Result<void> TryConnect();

  const std::string peer_;
  const ModbusBenderOptions options_;
  hal::Clock& clock_;
  const Make make_;
  const Prepare prepare_;
  ModbusHandle handle_;
  bool connected_ = false;
  int failed_connects_ = 0;
  hal::Error connect_problem_;  // of the last one that failed
  std::chrono::nanoseconds next_connect_{0};
};

}  // namespace bendloop::drivers
