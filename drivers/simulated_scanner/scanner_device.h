// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "drivers/scanner_wire/wire_decoder.h"
#include "drivers/scanner_wire/wire_encoder.h"
#include "drivers/simulated_scanner/random.h"
#include "drivers/simulated_scanner/scanner_fault.h"
#include "hal/clock.h"
#include "hal/profile_source.h"

namespace bendloop::drivers {

enum class ScanPace {
  kRealTime,  // at the profiles' times
  kMax,       // as fast as the host takes them
};

// The device's side of the wire protocol (../scanner_wire), without any I/O: plays scans to the
// host that has started it. A carrier (a socket, a USB gadget) brings it the host's bytes and takes
// its own away. Not thread-safe.
class ScannerDevice {
 public:
  // `clock` must outlive the device.
  ScannerDevice(WireIdentity identity, hal::Clock& clock);

  const WireIdentity& identity() const { return identity_; }

  // Somebody pulls the trigger: the scan runs as soon as a host has started the scanner and the
  // scans before are over. `scan` is open and started, and read without waiting to its end. Its
  // profiles with more points than the identity says are not sent.
  void Trigger(std::unique_ptr<hal::ProfileSource> scan, ScanPace pace);
  void Misbehave(ScannerFault misbehaviour) { misbehaviours_.push_back(misbehaviour); }
  // Ends a stall, and what makes it mute, before their time.
  void GoOn();
  // From the next scan on its clock runs fast by so much [ppm]; negative: slow.
  void set_clock_drift_ppm(double ppm) { drift_ppm_ = ppm; }

  // Scans that are not over yet, the running one included.
  std::size_t scans_waiting() const { return scans_.size(); }
  std::size_t scans_finished() const { return scans_finished_; }
  // Lost because the host went away or began anew in the middle, or the scan could not be read on.
  std::size_t scans_abandoned() const { return scans_abandoned_; }

  // Of the carrier.
  // A host came, or the one that was there has gone: everything between the two is forgotten.
  void HostCame();
  void HostWent();
  void Receive(std::span<const std::uint8_t> bytes);
  // Makes messages that are due while fewer than some 256 KiB wait.
  void Work();
  // Bytes for the host, until Sent() or another call.
  std::span<const std::uint8_t> Waiting() const {
    return {out_.data() + sent_, out_.size() - sent_};
  }
  void Sent(std::size_t bytes);
  // kCut, kHalt, kUnplug: for the carrier to do, once nothing waits.
  std::optional<ScannerFault> TakeCarrierFault();
  // How long nothing is due; 0: now.
  std::chrono::nanoseconds UntilDue() const;

 private:
  struct ActiveScan {
    std::unique_ptr<hal::ProfileSource> scan;
    ScanPace pace = ScanPace::kRealTime;
    bool begun = false;
    std::chrono::nanoseconds begun_at{0};
    std::int64_t first_t_ns = 0;
    // The item read last, not sent yet.
    hal::ReadStatus item = hal::ReadStatus::kTimeout;
  };

  void Answer(const WireMessage& request);
  bool IsMute() const;
  // Reads the next item of the first scan.
  void Fetch();
  void Abandon();
  void SendNext();
  bool SendProfile();
  void Flood(std::uint32_t messages);
  // Applies what waits; true if the next profile is not to be sent now.
  bool DoMisbehave();
  std::int64_t ItemTime() const;

  WireIdentity identity_;
  hal::Clock& clock_;
  bool started_ = false;
  WireDecoder decoder_;
  WireEncoder encoder_;
  std::vector<std::uint8_t> out_;
  std::size_t sent_ = 0;
  std::deque<ActiveScan> scans_;
  std::size_t scans_finished_ = 0;
  std::size_t scans_abandoned_ = 0;
  std::deque<ScannerFault> misbehaviours_;
  std::optional<ScannerFault> carrier_fault_;
  std::optional<std::chrono::nanoseconds> stalled_until_;
  std::optional<std::chrono::nanoseconds> mute_until_;
  double drift_ppm_ = 0;
  hal::LaserProfile profile_;
  hal::ScanEvent event_;
  Random random_{1};
};

}  // namespace bendloop::drivers
