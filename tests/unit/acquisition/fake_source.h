// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "hal/profile_source.h"

namespace bendloop::testing {

// Gives numbered profiles with `points` points each: scan_start, `count` profiles, scan_end, then
// the end, or an error when `fail_at` is reached. Allocates nothing.
class FakeSource final : public hal::ProfileSource {
 public:
  bool is_live = true;
  std::uint64_t count = 100;
  std::size_t points = 64;
  std::uint64_t fail_at = ~0ull;
  std::uint64_t skip_at = ~0ull;       // the scanner itself loses 3 profiles here
  std::function<void()> before_event;  // called before scan_end is given
  std::vector<std::int64_t> times_ns;  // of the first profiles; then 1000 ns apart
  bool stopped = false;

  hal::Result<hal::SourceInfo> Open() override { return info(); }
  hal::SourceInfo info() const { return {"fake", "1", "1", is_live, points}; }
  hal::Result<void> Start() override { return {}; }
  void Stop() override { stopped = true; }

  hal::Result<hal::ReadStatus> Read(hal::LaserProfile& profile, hal::ScanEvent& event,
                                    std::chrono::nanoseconds) override {
    const std::uint64_t step = step_++;
    if (step == 0) return Event(event, hal::ScanEventKind::kScanStart);
    const std::uint64_t i = step - 1;
    if (i == fail_at) return hal::Fail(hal::ErrorKind::kDevice, "fake: the cable was pulled");
    if (i < count) {
      profile.sequence = i + (i >= skip_at ? 3 : 0);
      profile.t_ns = i < times_ns.size() ? times_ns[i] : static_cast<std::int64_t>(i) * 1000;
      profile.points.clear();
      for (std::size_t p = 0; p < points; ++p) {
        profile.points.push_back({static_cast<float>(i), static_cast<float>(p)});
      }
      return hal::ReadStatus::kProfile;
    }
    if (i == count) {
      if (before_event) before_event();
      return Event(event, hal::ScanEventKind::kScanEnd);
    }
    return hal::ReadStatus::kEnd;
  }

 private:
  static hal::ReadStatus Event(hal::ScanEvent& event, hal::ScanEventKind kind) {
    event.kind = kind;
    event.set_detail("fake");
    return hal::ReadStatus::kEvent;
  }
  std::uint64_t step_ = 0;
};

}  // namespace bendloop::testing
