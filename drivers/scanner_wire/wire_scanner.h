// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/scanner_wire/byte_carrier.h"
#include "drivers/scanner_wire/wire_decoder.h"
#include "drivers/scanner_wire/wire_encoder.h"
#include "hal/profile_source.h"

namespace bendloop::drivers {

struct WireScannerOptions {
  std::chrono::nanoseconds answer_timeout = std::chrono::seconds(3);  // to identify and start
  std::optional<WireSettings> settings;                               // sent before start
  // A started scanner that has said nothing for so long is asked who it is; if it stays silent for
  // as long again, it is lost. 0: silence is never an error.
  std::chrono::nanoseconds patience{0};
};

// Since Open().
struct WireScannerCounters {
  WireCounters wire;
  std::uint64_t lost_profiles = 0;      // by profile sequence; each gap is a kGap event too
  std::uint64_t repeated_profiles = 0;  // dropped
  std::uint64_t bad_messages = 0;       // whole, but not what the protocol says; dropped
  std::uint64_t stale_messages = 0;     // profiles and events from before the start; dropped
};

// The host's side of the protocol (README.md) over any carrier. A lost connection, and a scanner
// that is silent beyond the patience, is a kDevice error and final until Open(); else silence is
// kTimeout. Lost profiles come as a kGap event before the next profile. Read() allocates nothing
// and takes no lock unless it fails.
class WireScanner : public hal::ProfileSource {
 public:
  WireScanner(std::unique_ptr<ByteCarrier> carrier, WireScannerOptions options);
  ~WireScanner() override { Stop(); }
  WireScanner(const WireScanner&) = delete;
  WireScanner& operator=(const WireScanner&) = delete;

  hal::Result<hal::SourceInfo> Open() override;
  // Returns when the scanner has said that it starts; kDevice with its words if it refuses.
  hal::Result<void> Start() override;
  hal::Result<hal::ReadStatus> Read(hal::LaserProfile& profile, hal::ScanEvent& event,
                                    std::chrono::nanoseconds timeout) override;
  // Asks the scanner to stop; it stays open for another Start().
  void Stop() override;
  std::string Remarks() const override;

  WireScannerCounters counters() const;
  const WireIdentity& identity() const { return identity_; }

 private:
  hal::Result<WireIdentity> Identify();
  void CountStale(const WireMessage& message);
  hal::Result<void> AwaitStart(std::uint32_t settings_sequence, std::uint32_t start_sequence);
  // What a message means for the reader; empty: nothing.
  std::optional<hal::ReadStatus> Take(const WireMessage& message, hal::LaserProfile& profile,
                                      hal::ScanEvent& event);
  std::optional<hal::ReadStatus> TakeProfile(const WireMessage& message, hal::LaserProfile& profile,
                                             hal::ScanEvent& event);
  hal::Result<void> WatchSilence(std::chrono::nanoseconds now, bool heard);
  tl::unexpected<hal::Error> FailForGood(hal::Error error);
  hal::Error Failure(const std::string& what) const;

  const WireScannerOptions options_;
  std::unique_ptr<ByteCarrier> carrier_;
  WireEncoder encoder_;
  WireDecoder decoder_;
  WireIdentity identity_;
  std::vector<std::uint8_t> request_;
  std::optional<hal::Error> failed_;
  bool started_ = false;
  std::optional<std::uint64_t> last_sequence_;
  std::optional<WireMessage> after_gap_;  // the profile that showed a gap, not yet delivered
  std::chrono::nanoseconds heard_at_{0};
  std::optional<std::chrono::nanoseconds> asked_at_;
  WireScannerCounters counters_;
};

}  // namespace bendloop::drivers
