// SPDX-License-Identifier: Apache-2.0
#include "drivers/usb_scanner/usb_scanner.h"

#include <utility>

#include "drivers/usb_scanner/libusb_port.h"
#include "drivers/usb_scanner/usb_carrier.h"

namespace bendloop::drivers {
namespace {

WireScannerOptions WireOptions(const UsbScannerOptions& options) {
  WireScannerOptions wire;
  wire.answer_timeout = options.answer_timeout;
  wire.settings = options.settings;
  wire.patience = options.patience;
  return wire;
}

}  // namespace

UsbScanner::UsbScanner(const UsbScannerOptions& options)
    : UsbScanner(options, std::make_unique<LibusbPort>()) {}

UsbScanner::UsbScanner(const UsbScannerOptions& options, std::unique_ptr<UsbPort> port)
    : WireScanner(std::make_unique<UsbCarrier>(options, std::move(port)), WireOptions(options)) {}

}  // namespace bendloop::drivers
