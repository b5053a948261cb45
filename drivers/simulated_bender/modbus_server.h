// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <modbus/modbus.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "drivers/isotp_bender/isotp_bender.h"
#include "drivers/register_bender/register_image.h"
#include "hal/result.h"

namespace bendloop::drivers {

// Exception codes of Modbus (application protocol V1.1b3, section 7).
inline constexpr std::uint8_t kIllegalFunction = 1;
inline constexpr std::uint8_t kIllegalAddress = 2;
inline constexpr std::uint8_t kIllegalValue = 3;

// One request as it came: header, function, data.
struct ModbusRequest {
  std::uint64_t client = 0;
  std::vector<std::uint8_t> bytes;
  std::size_t header = 7;  // bytes before the function: 1 on a serial line

  std::uint8_t function() const { return bytes[header]; }
  RegisterRange range() const;  // that functions 3, 4, 6 and 16 ask for
  bool is_write() const { return function() == 0x06 || function() == 0x10; }
};

// A Modbus TCP server on 127.0.0.1, an RTU one on a pseudo-terminal, or one on a CAN channel,
// without a thread: the owner polls.
class ModbusServer {
 public:
  static hal::Result<std::unique_ptr<ModbusServer>> Listen(std::uint16_t port);
  // One end of a new pseudo-terminal, as unit `unit_id`; device() is the other.
  static hal::Result<std::unique_ptr<ModbusServer>> OpenLine(std::uint8_t unit_id);
  // The other end of a CAN channel.
  static hal::Result<std::unique_ptr<ModbusServer>> OpenCan(const IsotpChannel& channel);
  ~ModbusServer();
  ModbusServer(const ModbusServer&) = delete;
  ModbusServer& operator=(const ModbusServer&) = delete;

  std::uint16_t port() const { return port_; }
  const std::string& device() const { return device_; }
  bool rtu() const { return far_line_ >= 0; }

  // Waits for requests, Wake or the timeout; well-formed requests go to `handle`.
  void Poll(std::chrono::milliseconds timeout,
            const std::function<void(const ModbusRequest&)>& handle);
  void Wake();  // from any thread

  // Executes a request of function 3, 4, 6 or 16 on `image` and sends the answer, from `unit`.
  // A client that is gone misses the answer only.
  void Execute(const ModbusRequest& request, RegisterImage& image);
  void ReplyException(const ModbusRequest& request, std::uint8_t code);
  void SendRaw(std::uint64_t client, const std::vector<std::uint8_t>& bytes);
  void HangUp(std::uint64_t client);
  void HangUpAll();

 private:
  struct Client {
    std::uint64_t id;
    int socket;
  };
  struct Free {
    void operator()(modbus_t* context) const { modbus_free(context); }
  };
  ModbusServer() = default;
  int SocketOf(std::uint64_t client) const;  // -1 if it is gone
  void Accept();
  bool Receive(const Client& client, const std::function<void(const ModbusRequest&)>& handle);

  std::unique_ptr<modbus_t, Free> context_;
  int listener_ = -1;
  int line_ = -1;      // our end
  int far_line_ = -1;  // the other end, held open so that the line never hangs up
  std::string device_;
  int wake_ = -1;
  std::uint16_t port_ = 0;
  std::uint64_t next_id_ = 1;
  std::vector<Client> clients_;
};

}  // namespace bendloop::drivers
