// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <string>

#include "hal/laser_profile.h"
#include "hal/result.h"
#include "hal/scan_event.h"

namespace bendloop::hal {

struct SourceInfo {
  std::string model;
  std::string serial;
  std::string firmware;
  bool is_live = true;         // false: a recording, which ends by itself
  std::size_t max_points = 0;  // most points of one profile
};

enum class ReadStatus {
  kProfile,  // `profile` was filled
  kEvent,    // `event` was filled
  kTimeout,  // nothing came in time; try again
  kEnd,      // a recording is over; nothing more will come
};

// Where laser profiles come from: a USB arm scanner, a simulated scanner, a recorded session.
// Calls come from one thread. Errors are kDevice (live) or kBadInput (recording) and final: the
// source must be opened again.
class ProfileSource {
 public:
  virtual ~ProfileSource() = default;

  virtual Result<SourceInfo> Open() = 0;
  virtual Result<void> Start() = 0;
  // Waits at most `timeout`. Allocates nothing while `profile` has the capacity of
  // SourceInfo::max_points and no error is returned.
  virtual Result<ReadStatus> Read(LaserProfile& profile, ScanEvent& event,
                                  std::chrono::nanoseconds timeout) = 0;
  virtual void Stop() = 0;
  // What went wrong since Open() without stopping the source, in words for the log; "" if nothing
  // did. Not while another thread reads.
  virtual std::string Remarks() const { return {}; }
};

}  // namespace bendloop::hal
