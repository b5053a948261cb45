// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <thread>

#include "firmware-host/cell/bender_desk.h"

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
  // `desk` outlives it.
  explicit BenderFollower(BenderDesk& desk);
  ~BenderFollower();
  BenderFollower(const BenderFollower&) = delete;
  BenderFollower& operator=(const BenderFollower&) = delete;

  // A look at once: a scan begins.
  void LookNow();
  // The latest look, once.
  std::optional<BenderReading> TakeNews();

 private:
  void Run();

  BenderDesk& desk_;
  std::mutex mutex_;  // of all below
  std::condition_variable wake_;
  std::optional<BenderReading> news_;
  bool look_now_ = false;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace bendloop::host
