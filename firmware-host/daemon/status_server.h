// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "hal/result.h"

namespace bendloop::host {

// What the running daemon tells:
//   GET /status   JSON, schema bendloop.status/1
//   GET /metrics  Prometheus text
// on 127.0.0.1, to whoever is on this machine and says so in Host, and on a socket in the file
// system, to the daemon's user and group. Each is a libmicrohttpd with a thread and 256 connections
// of its own; one that is silent for 2 s is closed. Who comes when all are taken waits in the
// kernel's queue until one is closed. So whoever keeps 256 busy, byte by byte, keeps others out of
// the port, but neither out of the socket nor the cell from measuring. Where there is no memory for
// an answer that is said (503) or, when there is none for that, the connection closed.
class StatusServer {
 public:
  // Each may be asked by both threads at once.
  struct Pages {
    std::function<std::string()> status;
    std::function<std::string()> metrics;
    // A question went without its answer; may be empty, must need no memory.
    std::function<void()> out_of_memory = {};
  };

  // `port` 0 picks a free one; `socket` "": none. kDevice when the port is taken or the socket
  // cannot be made.
  static hal::Result<std::unique_ptr<StatusServer>> Start(std::uint16_t port,
                                                          const std::filesystem::path& socket,
                                                          Pages pages);
  ~StatusServer();

  std::uint16_t port() const;

 private:
  class Impl;
  explicit StatusServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace bendloop::host
