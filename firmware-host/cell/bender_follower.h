// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <thread>

#include "firmware-host/cell/bender_desk.h"
#include "firmware-host/cell/cell_status.h"
#include "firmware-host/cell/plc_reporter.h"

namespace bendloop::host {

// How long to leave the bender alone after a look that took so long. A quarter of a second; while
// a cycle runs a twentieth, or as long as the look took: the moment in which its tube is counted is
// to be known well, because a scan that begins within it cannot be told from one of the tube before
// (ledger/README.md).
std::chrono::nanoseconds PauseAfter(const BenderReading& look, std::chrono::nanoseconds took);

// Looks at the bender a few times a second, all the time, beside the loop: what the ledger knows of
// it must not depend on what the cell is doing. Each look is bounded by the link's timeouts.
class BenderFollower {
 public:
  // All outlive it; what `reporter` has for the PLC is written after a look that was answered. A
  // look that found no memory is no answer: `board` is told, and the next one comes in its time.
  BenderFollower(BenderDesk& desk, PlcReporter* reporter, StatusBoard& board);
  ~BenderFollower();
  BenderFollower(const BenderFollower&) = delete;
  BenderFollower& operator=(const BenderFollower&) = delete;

  // A look at once: a scan begins.
  void LookNow();
  // The same, waiting for its answer; empty: there was none in that time.
  std::optional<BenderReading> LookWithin(std::chrono::nanoseconds patience);
  // The latest look, once.
  std::optional<BenderReading> TakeNews();

 private:
  void Run();
  // How long the look took; empty: there was no memory for it.
  std::optional<std::chrono::nanoseconds> Look(BenderReading& now, BenderReading& copy);

  BenderDesk& desk_;
  PlcReporter* const reporter_;
  StatusBoard& board_;
  std::mutex mutex_;  // of all below
  std::condition_variable wake_;
  std::condition_variable answered_;
  std::optional<BenderReading> news_;
  std::optional<BenderReading> latest_;
  std::uint64_t begun_ = 0;  // looks
  std::uint64_t ended_ = 0;
  bool look_now_ = false;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace bendloop::host
