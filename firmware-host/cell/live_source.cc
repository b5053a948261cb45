// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/live_source.h"

#include <pthread.h>

#include <cmath>
#include <optional>
#include <utility>

#include "drivers/session/session_source.h"
#include "drivers/stream_scanner/stream_scanner.h"
#include "drivers/usb_scanner/usb_scanner.h"

namespace bendloop::host {
namespace {

std::optional<drivers::WireSettings> SettingsOf(const config::ScannerConfig& scanner) {
  if (scanner.profiles_per_second <= 0 && scanner.exposure_us == 0) return std::nullopt;
  drivers::WireSettings settings;
  settings.profiles_per_second_milli =
      static_cast<std::uint32_t>(std::lround(scanner.profiles_per_second * 1000));
  settings.exposure_us = scanner.exposure_us;
  return settings;
}

drivers::UsbScannerOptions UsbOptions(const config::ScannerConfig& scanner,
                                      const RealtimePolicy& realtime) {
  drivers::UsbScannerOptions options;
  if (const auto id = config::ParseUsbId(scanner.usb_id)) {
    options.match.vendor = id->vendor;
    options.match.product = id->product;
  }
  options.match.serial = scanner.serial;
  options.settings = SettingsOf(scanner);
  options.start_thread = [realtime](std::function<void()> work) {
    return std::thread([realtime, work = std::move(work)] {
      pthread_setname_np(pthread_self(), "usb");
      // What is not granted is told for the acquisition thread, which asks for the same.
      (void)ApplyRealtime(realtime);
      work();
    });
  };
  return options;
}

}  // namespace

hal::Result<std::unique_ptr<hal::ProfileSource>> MakeSource(const config::ScannerConfig& scanner,
                                                            hal::Clock& clock,
                                                            const RealtimePolicy& realtime) {
  switch (scanner.kind) {
    case config::ScannerKind::kSimulated:  // bendloop-simscanner speaks as a stream scanner does
    case config::ScannerKind::kStream: {
      drivers::StreamScannerOptions options;
      options.host = scanner.host;
      options.port = scanner.port;
      options.settings = SettingsOf(scanner);
      return std::make_unique<drivers::StreamScanner>(options);
    }
    case config::ScannerKind::kUsb:
      return std::make_unique<drivers::UsbScanner>(UsbOptions(scanner, realtime));
    case config::ScannerKind::kSession:
      return std::make_unique<drivers::SessionSource>(scanner.session.string(),
                                                      drivers::ReplayPace::kRecorded, clock);
  }
  return hal::Fail(hal::ErrorKind::kInternal, "[scanner] kind: unknown");
}

}  // namespace bendloop::host
