// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "drivers/scanner_wire/wire_decoder.h"
#include "drivers/scanner_wire/wire_encoder.h"
#include "drivers/stream_scanner/tcp_connection.h"
#include "hal/profile_source.h"

namespace bendloop::drivers {

struct StreamScannerOptions {
  std::string host = "127.0.0.1";
  std::uint16_t port = 0;
  std::chrono::nanoseconds connect_timeout = std::chrono::seconds(3);  // and until it has answered
  std::optional<WireSettings> settings;                                // sent before start
};

struct StreamScannerCounters {
  WireCounters wire;
  std::uint64_t lost_profiles = 0;      // by profile sequence; each gap is a kGap event too
  std::uint64_t repeated_profiles = 0;  // dropped
  std::uint64_t bad_messages = 0;       // whole, but not what the protocol says; dropped
};

// A scanner that speaks the wire protocol (../scanner_wire) over TCP. A lost connection is a
// kDevice error and final until Open(); a silent scanner is kTimeout. Lost profiles come as a kGap
// event before the next profile. Read() allocates nothing unless it fails.
class StreamScanner final : public hal::ProfileSource {
 public:
  explicit StreamScanner(StreamScannerOptions options) : options_(std::move(options)) {}
  ~StreamScanner() override { Stop(); }

  hal::Result<hal::SourceInfo> Open() override;
  hal::Result<void> Start() override;
  hal::Result<hal::ReadStatus> Read(hal::LaserProfile& profile, hal::ScanEvent& event,
                                    std::chrono::nanoseconds timeout) override;
  // Asks the scanner to stop; the connection stays for another Start().
  void Stop() override;

  // Since Open().
  StreamScannerCounters counters() const;
  const WireIdentity& identity() const { return identity_; }

 private:
  // True if bytes came.
  hal::Result<bool> ReceiveMore(std::chrono::nanoseconds timeout);
  hal::Result<WireIdentity> Identify();
  std::optional<hal::ReadStatus> TakeProfile(const WireMessage& message, hal::LaserProfile& profile,
                                             hal::ScanEvent& event);
  hal::Error FailForGood(hal::Error error);

  StreamScannerOptions options_;
  TcpConnection connection_;
  WireEncoder encoder_;
  WireDecoder decoder_;
  WireIdentity identity_;
  std::optional<hal::Error> failed_;
  bool started_ = false;
  std::optional<std::uint64_t> last_sequence_;
  std::optional<WireMessage> after_gap_;  // the profile that showed a gap, not yet delivered
  StreamScannerCounters counters_;
};

}  // namespace bendloop::drivers
