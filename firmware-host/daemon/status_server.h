// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "firmware-host/result/json.h"
#include "hal/result.h"

namespace bendloop::host {

// What the running daemon tells, on a thread of its own:
//   GET /status   JSON, schema bendloop.status/1
//   GET /metrics  Prometheus text
// on 127.0.0.1, to whoever is on this machine and says so in Host, and on a socket in the file
// system, to the daemon's user and group. One poll loop for all connections: at most 64, each
// closed 2 s after it came. When all are taken the one that has said nothing for longest makes
// room, so that idle connections keep nobody out.
class StatusServer {
 public:
  struct Pages {
    std::function<std::string()> status;
    std::function<std::string()> metrics;
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

// GET from a server on this machine within `timeout_s`; kDevice when nobody answers.
hal::Result<std::string> FetchLocal(std::uint16_t port, const std::string& path, int timeout_s = 2);

// /status at this port; kDevice when there is no daemon.
hal::Result<Json> FetchStatus(std::uint16_t port);
// /status of the daemon whose address stands in this file of its state directory: by its socket,
// else by its port. kDevice when there is no daemon, or when this user may not know.
hal::Result<Json> FetchStatus(const std::filesystem::path& address_file);

}  // namespace bendloop::host
