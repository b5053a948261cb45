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

// What the running daemon tells on 127.0.0.1, on a thread of its own:
//   GET /status   JSON, schema bendloop.status/1
//   GET /metrics  Prometheus text
class StatusServer {
 public:
  struct Pages {
    std::function<std::string()> status;
    std::function<std::string()> metrics;
  };

  // `port` 0 picks a free one. kDevice when the port is taken.
  static hal::Result<std::unique_ptr<StatusServer>> Start(std::uint16_t port, Pages pages);
  ~StatusServer();

  std::uint16_t port() const;

 private:
  class Impl;
  explicit StatusServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

// GET from a server on this machine within `timeout_s`; kDevice when nobody answers.
hal::Result<std::string> FetchLocal(std::uint16_t port, const std::string& path, int timeout_s = 2);

// /status of the daemon whose address stands in this file of its state directory; kDevice when
// there is no daemon.
hal::Result<Json> FetchStatus(const std::filesystem::path& address_file);

}  // namespace bendloop::host
