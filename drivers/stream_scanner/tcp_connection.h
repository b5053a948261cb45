// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "hal/result.h"

namespace bendloop::drivers {

// One TCP connection to a device, closed with the object. Errors are kDevice and name the peer.
class TcpConnection {
 public:
  static hal::Result<TcpConnection> Connect(const std::string& host, std::uint16_t port,
                                            std::chrono::nanoseconds timeout);

  TcpConnection() = default;
  TcpConnection(TcpConnection&& other) noexcept;
  TcpConnection& operator=(TcpConnection&& other) noexcept;
  TcpConnection(const TcpConnection&) = delete;
  TcpConnection& operator=(const TcpConnection&) = delete;
  ~TcpConnection() { Close(); }

  bool is_open() const { return socket_ >= 0; }
  const std::string& peer() const { return peer_; }
  void Close();

  // Sends all of it or fails.
  hal::Result<void> Send(std::span<const std::uint8_t> bytes, std::chrono::nanoseconds timeout);
  // Waits at most `timeout`; 0 if nothing came. Allocates nothing unless it fails.
  hal::Result<std::size_t> Receive(std::span<std::uint8_t> bytes, std::chrono::nanoseconds timeout);

 private:
  hal::Error Failure(const std::string& what) const;

  int socket_ = -1;
  std::string peer_;
};

}  // namespace bendloop::drivers
