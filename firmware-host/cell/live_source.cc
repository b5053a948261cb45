// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/live_source.h"

#include "drivers/session/session_source.h"
#include "drivers/stream_scanner/stream_scanner.h"

namespace bendloop::host {

hal::Result<std::unique_ptr<hal::ProfileSource>> MakeSource(const config::ScannerConfig& scanner,
                                                            hal::Clock& clock) {
  switch (scanner.kind) {
    case config::ScannerKind::kSimulated:  // bendloop-simscanner speaks as a stream scanner does
    case config::ScannerKind::kStream: {
      drivers::StreamScannerOptions options;
      options.host = scanner.host;
      options.port = scanner.port;
      return std::make_unique<drivers::StreamScanner>(options);
    }
    case config::ScannerKind::kSession:
      return std::make_unique<drivers::SessionSource>(scanner.session.string(),
                                                      drivers::ReplayPace::kRecorded, clock);
  }
  return hal::Fail(hal::ErrorKind::kInternal, "[scanner] kind: unknown");
}

}  // namespace bendloop::host
