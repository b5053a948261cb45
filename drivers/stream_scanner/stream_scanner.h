// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

#include "drivers/scanner_wire/wire_scanner.h"

namespace bendloop::drivers {

struct StreamScannerOptions {
  std::string host = "127.0.0.1";
  std::uint16_t port = 0;
  std::chrono::nanoseconds connect_timeout = std::chrono::seconds(3);  // and until it has answered
  std::optional<WireSettings> settings;                                // sent before start
};

// A scanner that speaks the wire protocol (../scanner_wire) over TCP. A silent one is kTimeout; the
// kernel asks after a host that has vanished (keep-alive).
class StreamScanner final : public WireScanner {
 public:
  explicit StreamScanner(const StreamScannerOptions& options);
};

}  // namespace bendloop::drivers
