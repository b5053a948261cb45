// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>

#include "drivers/simulated_scanner/scanner_device.h"
#include "drivers/simulated_scanner/virtual_scan.h"
#include "hal/clock.h"
#include "hal/result.h"

namespace bendloop::drivers {

// A scanner on a loopback TCP port that speaks the wire protocol (../scanner_wire) and streams
// virtual scans. One host at a time; a further one is turned away. No threads: whoever owns it
// calls Poll() again and again.
class SimulatedScanner {
 public:
  // Port 0 takes any free one. `clock` must outlive the scanner.
  static hal::Result<std::unique_ptr<SimulatedScanner>> Listen(std::uint16_t port,
                                                               WireIdentity identity,
                                                               hal::Clock& clock);
  ~SimulatedScanner();
  SimulatedScanner(const SimulatedScanner&) = delete;
  SimulatedScanner& operator=(const SimulatedScanner&) = delete;

  std::uint16_t port() const { return port_; }
  bool has_host() const { return host_ >= 0; }
  std::size_t scans_finished() const { return device_.scans_finished(); }
  std::size_t scans_abandoned() const { return device_.scans_abandoned(); }

  // Somebody pulls the trigger (ScannerDevice).
  void Trigger(std::shared_ptr<const VirtualScan> scan, ScanPace pace);
  ScannerDevice& device() { return device_; }
  void Misbehave(ScannerFault misbehaviour) { device_.Misbehave(misbehaviour); }

  // Serves the network and sends what is due. Waits at most `timeout` if there is nothing to do.
  hal::Result<void> Poll(std::chrono::nanoseconds timeout);
  // A descriptor that makes a waiting Poll() return when it becomes readable, e.g. 0; -1 for none.
  void WakeOn(int descriptor) { wake_ = descriptor; }

 private:
  SimulatedScanner(WireIdentity identity, hal::Clock& clock)
      : device_(std::move(identity), clock) {}
  void Accept();
  void DropHost();
  void ReceiveRequests();
  void Flush();
  // Makes messages while some are due and the host takes them.
  void SendDue();

  ScannerDevice device_;
  int listener_ = -1;
  int host_ = -1;
  int wake_ = -1;
  std::uint16_t port_ = 0;
};

}  // namespace bendloop::drivers
