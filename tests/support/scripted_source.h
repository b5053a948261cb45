// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <thread>
#include <utility>
#include <vector>

#include "drivers/simulated_scanner/virtual_scan.h"
#include "hal/profile_source.h"
#include "hal/tube.h"
#include "tests/support/hand_clock.h"

namespace bendloop::tests {

// A scanner that does what its script says, sensible or not.
class ScriptedSource final : public hal::ProfileSource {
 public:
  enum class Kind { kProfile, kStart, kEnd, kSilence, kPause };  // a pause: no time goes by
  struct Step {
    Kind kind = Kind::kProfile;
    std::size_t profile = 0;
  };
  ScriptedSource(const std::vector<hal::LaserProfile>& profiles, std::vector<Step> steps,
                 HandClock& clock)
      : profiles_(profiles), steps_(std::move(steps)), clock_(clock) {}

  hal::Result<hal::SourceInfo> Open() override { return Info(); }
  hal::SourceInfo Info() const {
    std::size_t most = 0;
    for (const auto& p : profiles_) most = std::max(most, p.points.size());
    return {"scripted", "1", "1", true, most};
  }
  hal::Result<void> Start() override { return {}; }
  void Stop() override {}
  hal::Result<hal::ReadStatus> Read(hal::LaserProfile& profile, hal::ScanEvent& event,
                                    std::chrono::nanoseconds) override {
    if (next_ == steps_.size()) return hal::ReadStatus::kEnd;
    const Step step = steps_[next_++];
    switch (step.kind) {
      case Kind::kProfile:
        profile = profiles_[step.profile];
        return hal::ReadStatus::kProfile;
      case Kind::kSilence:
      case Kind::kPause:
        // Until the loop has taken what came before and looked at the clock since.
        if (silence_over && !silence_over()) --next_;
        if (step.kind == Kind::kSilence) clock_.Advance(std::chrono::seconds(1));
        std::this_thread::yield();
        return hal::ReadStatus::kTimeout;
      case Kind::kStart:
      case Kind::kEnd:
        break;
    }
    event.kind =
        step.kind == Kind::kStart ? hal::ScanEventKind::kScanStart : hal::ScanEventKind::kScanEnd;
    event.t_ns = profiles_.back().t_ns;
    event.set_detail("");
    return hal::ReadStatus::kEvent;
  }
  bool over() const { return next_ == steps_.size(); }

  std::function<bool()> silence_over;

 private:
  const std::vector<hal::LaserProfile>& profiles_;
  const std::vector<Step> steps_;
  HandClock& clock_;
  std::atomic<std::size_t> next_{0};
};

// The profiles of one scan of `tube` from three sides, sparse enough for a test.
inline std::vector<hal::LaserProfile> SparseScan(const hal::Tube& tube, double spacing_mm,
                                                 std::size_t rays) {
  drivers::VirtualScanOptions options;
  options.path.views_deg = drivers::SpreadViewsDeg(3);
  options.path.profile_spacing_mm = spacing_mm;
  options.rays = rays;
  options.fan_half_angle_deg = 4;
  const drivers::VirtualScan scan(tube, options);
  std::vector<hal::LaserProfile> profiles;
  for (std::size_t i = 0; i < scan.profile_count(); ++i) {
    scan.Make(i, profiles.emplace_back(scan.max_points()));
  }
  return profiles;
}

// The steps of that scan from its begin to its end.
inline std::vector<ScriptedSource::Step> CleanScan(std::size_t profiles) {
  using Kind = ScriptedSource::Kind;
  std::vector<ScriptedSource::Step> steps = {{Kind::kStart, 0}};
  for (std::size_t i = 0; i < profiles; ++i) steps.push_back({Kind::kProfile, i});
  steps.push_back({Kind::kEnd, 0});
  return steps;
}

}  // namespace bendloop::tests
