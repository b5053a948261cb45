// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <thread>

#include "drivers/scanner_wire/wire_scanner.h"
#include "drivers/usb_scanner/usb_port.h"

namespace bendloop::drivers {

struct UsbScannerOptions {
  UsbMatch match;
  std::optional<WireSettings> settings;  // sent before start
  std::chrono::nanoseconds answer_timeout = std::chrono::seconds(3);
  std::chrono::nanoseconds arrival_timeout = std::chrono::seconds(1);  // for one that is not there
  std::chrono::nanoseconds patience = std::chrono::seconds(2);         // as WireScannerOptions
  std::size_t transfers = 32;                                          // in flight
  std::size_t transfer_bytes = 16384;  // each; more latency, less work
  // Runs the driver's USB work; whoever owns the threads decides on name and priority.
  std::function<std::thread(std::function<void()>)> start_thread = [](std::function<void()> work) {
    return std::thread(std::move(work));
  };
};

// A scanner on USB that speaks the wire protocol (../scanner_wire, "On USB"). An unplugged one is a
// kDevice error and final until Open(), which finds it again; so is one that stalls or fails again
// and again, and one that says nothing for twice the patience.
class UsbScanner final : public WireScanner {
 public:
  explicit UsbScanner(const UsbScannerOptions& options);
  // Over another port, for tests.
  UsbScanner(const UsbScannerOptions& options, std::unique_ptr<UsbPort> port);
};

}  // namespace bendloop::drivers
