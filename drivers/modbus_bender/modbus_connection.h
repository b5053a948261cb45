// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <modbus/modbus.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/modbus_bender/modbus_bender.h"
#include "drivers/register_bender/register_image.h"
#include "hal/clock.h"
#include "hal/result.h"

namespace bendloop::drivers {

// One Modbus connection: transactions of bounded time, each answer checked down to transaction and
// unit id. A transaction that fails closes the connection, so that a late answer can never be taken
// for a later one's; the next call connects again. RTU numbers no transactions: there the line is
// listened to until it has been given up for one more response timeout, and what comes is thrown
// away. Errors are kDevice and name address,
// function and registers.
class ModbusConnection {
 public:
  ModbusConnection(ModbusBenderOptions options, hal::Clock& clock);
  ~ModbusConnection() { Close(); }
  ModbusConnection(const ModbusConnection&) = delete;
  ModbusConnection& operator=(const ModbusConnection&) = delete;

  // Does nothing when connected.
  hal::Result<void> Connect();
  // range.count <= 125; `to` takes as many.
  hal::Result<void> Read(const RegisterRange& range, std::uint16_t* to);
  // FC 16 (FC 6 for one register); range.count <= 123, holding registers only.
  hal::Result<void> Write(const RegisterRange& range, const std::uint16_t* from);
  void Close();

  std::string peer() const;     // "127.0.0.1:502 unit 1", "/dev/ttyS1 unit 1"
  std::string carrier() const;  // "Modbus TCP", "Modbus RTU", "Modbus on CAN"

 private:
  struct Free {
    void operator()(modbus_t* context) const;
  };

  bool rtu() const { return options_.serial.has_value(); }
  bool can() const { return options_.can.has_value(); }
  int Socket() const { return can() ? can_socket_ : modbus_get_socket(context_.get()); }
  hal::Result<void> ConnectCan();
  hal::Result<void> MakeContext();
  hal::Result<void> PrepareLine();  // after the port was opened
  void ListenUntilQuiet();

  int ReceiveCan(std::uint8_t* answer, std::size_t size) const;  // as libmodbus: -1 and errno
  hal::Result<void> Send(const std::vector<std::uint8_t>& request);
  hal::Result<void> CheckHeader(const std::uint8_t* answer, std::size_t size) const;
  // Sends a request (function and data) and returns the checked answer (function and data).
  hal::Result<std::vector<std::uint8_t>> Transact(const std::vector<std::uint8_t>& request,
                                                  const std::string& what);
  hal::Result<std::vector<std::uint8_t>> Exchange(const std::vector<std::uint8_t>& request,
                                                  const std::string& what);

  ModbusBenderOptions options_;
  hal::Clock& clock_;
  std::unique_ptr<modbus_t, Free> context_;
  int can_socket_ = -1;
  bool connected_ = false;
  std::uint16_t transaction_ = 0;
  int failed_connects_ = 0;
  std::chrono::nanoseconds next_connect_{0};
  std::optional<std::chrono::nanoseconds> quiet_at_;  // RTU: a late answer may come until then
};

}  // namespace bendloop::drivers
