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
  std::chrono::nanoseconds patience = std::chrono::seconds(5);         // as WireScannerOptions
};

// A scanner that speaks the wire protocol (../scanner_wire) over TCP. One that says nothing for
// twice the patience, although it was asked, is lost, even if its end of the connection lives; so
// is a host that has vanished, after which the kernel asks (keep-alive).
class StreamScanner final : public WireScanner {
 public:
  explicit StreamScanner(const StreamScannerOptions& options);
};

}  // namespace bendloop::drivers
