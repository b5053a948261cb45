// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_scanner/scanner_device.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "hal/clock.h"

namespace bendloop::drivers {
namespace {

using std::chrono::nanoseconds;

// A recording of empty profiles at these times.
class TimesSource final : public hal::ProfileSource {
 public:
  explicit TimesSource(std::vector<std::int64_t> times) : times_(std::move(times)) {}
  hal::Result<hal::SourceInfo> Open() override { return hal::SourceInfo{}; }
  hal::Result<void> Start() override { return {}; }
  hal::Result<hal::ReadStatus> Read(hal::LaserProfile& profile, hal::ScanEvent&,
                                    nanoseconds) override {
    if (next_ == times_.size()) return hal::ReadStatus::kEnd;
    profile.points.clear();
    profile.t_ns = times_[next_++];
    return hal::ReadStatus::kProfile;
  }
  void Stop() override {}

 private:
  std::vector<std::int64_t> times_;
  std::size_t next_ = 0;
};

class ScannerDeviceTest : public ::testing::Test {
 protected:
  void Play(std::vector<std::int64_t> times) {
    device_.Trigger(std::make_unique<TimesSource>(std::move(times)), ScanPace::kRealTime);
    std::vector<std::uint8_t> start;
    WireEncoder().Append(WireType::kStart, {}, start);
    device_.Receive(start);
    device_.Work();
  }

  hal::SteadyClock clock_;
  ScannerDevice device_{{"simulated", "1", "1", "none", 100}, clock_};
};

TEST_F(ScannerDeviceTest, TimesThatAreFurtherApartThanNumbersGoAreWaitedForAndDoNotOverflow) {
  device_.set_clock_drift_ppm(200);
  Play({INT64_MIN, INT64_MAX});
  EXPECT_GT(device_.UntilDue(), std::chrono::hours(24 * 365));
}

TEST_F(ScannerDeviceTest, TimesThatGoBackAreDueAtOnce) {
  Play({INT64_MAX, INT64_MIN, INT64_MAX});
  EXPECT_EQ(device_.scans_waiting(), 0u);
}

TEST_F(ScannerDeviceTest, WhatStallsOrIsMuteInTheMiddleOfAScanStandsStillUntilItIsToldToGoOn) {
  for (const auto kind : {ScannerFault::Kind::kStall, ScannerFault::Kind::kMute}) {
    constexpr std::uint32_t kHourMs = 3'600'000;
    device_.Misbehave({kind, kHourMs, 2});
    Play({0, 0, 0, 0});
    EXPECT_EQ(device_.scans_waiting(), 1u);
    EXPECT_GT(device_.UntilDue(), std::chrono::minutes(59));
    device_.GoOn();
    EXPECT_EQ(device_.UntilDue(), nanoseconds(0));
    device_.Work();
    EXPECT_EQ(device_.scans_waiting(), 0u);
  }
}

}  // namespace
}  // namespace bendloop::drivers
