// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "hal/clock.h"
#include "hal/profile_source.h"
#include "hal/tube.h"

namespace bendloop::bench {

// A tube of one inch, 0.9 m long with four bends, each so much more than the nominal's.
hal::Tube LoadTube(double off_deg);
inline constexpr double kBentOffDeg = 0.4;  // one part too far, the next too little

// Everything of a scan that is costly to make, made before: sensor poses along the tube, pass after
// pass from another side, and noisy laser lines. The laser plane stands across the spine, where a
// tube's section is a circle in bends as well, so each line fits each place.
struct LoadScan {
  static constexpr std::size_t kPoints = 2000;  // of each line
  std::vector<hal::Pose> X_WS;                  // all passes
  std::vector<std::vector<hal::ProfilePoint>> lines;
};

// Of six passes with lines 1 mm apart and noise of 0.03 mm along the surface normal, 1 sigma.
LoadScan MakeLoadScan(const hal::Tube& tube, std::uint64_t seed);

// A live scanner that gives scans on demand, paced by `clock`. When it is not asked in time, what
// was due waits, as in a device's memory.
class LoadSource final : public hal::ProfileSource {
 public:
  explicit LoadSource(hal::Clock& clock) : clock_(clock) {}

  struct Order {
    const LoadScan* scan = nullptr;
    std::uint64_t profiles = 0;  // the passes are repeated for so long
    double profiles_per_second = 0;
    std::uint64_t first_line = 0;  // other noise at the same places
  };
  // From any thread, when the scan before is over. The order outlives the scan.
  void Trigger(const Order* order) { order_.store(order, std::memory_order_release); }
  // When the last profile of the latest scan was exposed, on the clock [ns].
  std::int64_t last_due_ns() const { return last_due_ns_.load(); }
  std::int64_t first_due_ns() const { return first_due_ns_.load(); }

  hal::Result<hal::SourceInfo> Open() override { return Info(); }
  static hal::SourceInfo Info() { return {"synthetic load", "", "1", true, LoadScan::kPoints}; }
  hal::Result<void> Start() override { return {}; }
  void Stop() override {}
  hal::Result<hal::ReadStatus> Read(hal::LaserProfile& profile, hal::ScanEvent& event,
                                    std::chrono::nanoseconds timeout) override;

 private:
  std::chrono::nanoseconds DueTime(std::uint64_t index) const;

  hal::Clock& clock_;
  std::atomic<const Order*> order_{nullptr};
  std::atomic<std::int64_t> first_due_ns_{0};
  std::atomic<std::int64_t> last_due_ns_{0};
  const Order* running_ = nullptr;
  std::chrono::nanoseconds begun_{0};
  std::uint64_t next_ = 0;
};

}  // namespace bendloop::bench
