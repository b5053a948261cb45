// SPDX-License-Identifier: Apache-2.0
#include "drivers/stream_scanner/stream_scanner.h"

#include <gtest/gtest.h>

#include <atomic>
#include <functional>
#include <mutex>
#include <thread>

#include "drivers/simulated_scanner/simulated_scanner.h"

namespace bendloop::drivers {
namespace {

using hal::ReadStatus;
using hal::ScanEventKind;
using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using std::chrono::seconds;
using Kind = ScannerFault::Kind;

// The simulated scanner in a thread of its own.
class StreamScannerTest : public ::testing::Test {
 protected:
  StreamScannerTest() {
    scan_options_.path.profile_spacing_mm = 8;
    scan_options_.rays = 200;
    tube_ = LayOnTable(
        hal::Tube{8, {{{120, 0, 60, 25.0}, {80, 90, 45, 25.0}, {60, 0, 0, std::nullopt}}}, {}}, 1);
    scan_ = std::make_shared<VirtualScan>(tube_, scan_options_);
    auto made = SimulatedScanner::Listen(0, {"sim", "S1", "1.0", "cal", 200}, clock_);
    EXPECT_TRUE(made);
    device_ = std::move(*made);
    options_.port = device_->port();
    thread_ = std::thread([this] {
      while (!stop_) {
        while (wanted_) std::this_thread::yield();  // a mutex alone may starve who waits for it
        const std::lock_guard lock(mutex_);
        EXPECT_TRUE(device_->Poll(milliseconds(1)));
      }
    });
  }
  ~StreamScannerTest() override {
    stop_ = true;
    thread_.join();
  }
  void Device(const std::function<void(SimulatedScanner&)>& action) {
    wanted_ = true;
    const std::lock_guard lock(mutex_);
    wanted_ = false;
    action(*device_);
  }
  void Trigger(std::initializer_list<ScannerFault> misbehaviours = {}) {
    Device([&](SimulatedScanner& device) {
      for (const auto& misbehaviour : misbehaviours) device.Misbehave(misbehaviour);
      device.Trigger(scan_, ScanPace::kMax);
    });
  }
  // Everything until the scan's end, an error, or a generous deadline, in words.
  std::vector<std::string> ReadScan(StreamScanner& scanner) {
    std::vector<std::string> words;
    hal::LaserProfile profile(200);
    hal::ScanEvent event;
    const auto* const storage = profile.points.data();
    const nanoseconds deadline = clock_.Now() + seconds(20);
    while (clock_.Now() < deadline) {
      const auto status = scanner.Read(profile, event, milliseconds(50));
      EXPECT_EQ(profile.points.data(), storage);
      if (!status) {
        words.push_back("error " + status.error().message);
        break;
      }
      if (*status == ReadStatus::kProfile) words.push_back(std::to_string(profile.sequence));
      if (*status == ReadStatus::kEvent) {
        words.push_back(std::string(hal::Name(event.kind)) + " " + std::string(event.detail()));
        if (event.kind == ScanEventKind::kScanEnd) break;
      }
    }
    return words;
  }
  std::vector<std::string> WholeScan() const {
    std::vector<std::string> words = {"scan_start "};
    for (std::size_t i = 0; i < scan_->profile_count(); ++i) words.push_back(std::to_string(i));
    words.emplace_back("scan_end ");
    return words;
  }

  hal::SteadyClock clock_;
  VirtualScanOptions scan_options_;
  hal::Tube tube_;
  std::shared_ptr<const VirtualScan> scan_;
  std::unique_ptr<SimulatedScanner> device_;
  StreamScannerOptions options_;
  std::mutex mutex_;
  std::atomic<bool> stop_ = false;
  std::atomic<bool> wanted_ = false;
  std::thread thread_;
};

TEST_F(StreamScannerTest, DeliversTheScanTwiceAndAfterReopening) {
  options_.settings = WireSettings{};
  StreamScanner scanner(options_);
  for (int round = 0; round < 2; ++round) {
    const auto info = scanner.Open();
    ASSERT_TRUE(info) << info.error().message;
    EXPECT_EQ(info->model, "sim");
    EXPECT_EQ(info->serial, "S1");
    EXPECT_EQ(info->max_points, 200u);
    EXPECT_TRUE(info->is_live);
    ASSERT_TRUE(scanner.Start());
    Trigger();
    EXPECT_EQ(ReadScan(scanner), WholeScan());
    Trigger();
    EXPECT_EQ(ReadScan(scanner), WholeScan());
    EXPECT_EQ(scanner.counters().lost_profiles, 0u);
    EXPECT_EQ(scanner.counters().wire.resyncs, 0u);
    scanner.Stop();
  }
}

TEST_F(StreamScannerTest, ReportsLostProfilesAsGaps) {
  StreamScanner scanner(options_);
  ASSERT_TRUE(scanner.Open());
  ASSERT_TRUE(scanner.Start());
  // The first profile of a scan cannot be known to be missing, so let some pass.
  Trigger({{Kind::kRepeat, 1}, {Kind::kGarbage, 3000}, {Kind::kCorrupt, 1}, {Kind::kBadPose, 1}});
  const auto words = ReadScan(scanner);
  EXPECT_EQ(scanner.counters().repeated_profiles, 0u);
  EXPECT_EQ(scanner.counters().bad_messages, 1u);
  EXPECT_EQ(scanner.counters().wire.payload_errors, 1u);
  EXPECT_GE(scanner.counters().wire.resyncs, 1u);
  ASSERT_GT(words.size(), 4u);
  EXPECT_EQ(words[0], "scan_start ");
  EXPECT_EQ(words[1], "0");
  EXPECT_EQ(words[2], "gap 1 profiles lost, sequence 1 to 1");
  EXPECT_EQ(words[3], "2");
  EXPECT_EQ(words.back(), "scan_end ");
}

TEST_F(StreamScannerTest, CountsAWideGap) {
  StreamScanner scanner(options_);
  ASSERT_TRUE(scanner.Open());
  ASSERT_TRUE(scanner.Start());
  // A repeated first profile, so that the gap is not at the very beginning.
  Trigger({{Kind::kRepeat, 1}, {Kind::kFault, 1}, {Kind::kStall, 1}, {Kind::kGap, 7}});
  auto words = ReadScan(scanner);
  ASSERT_GT(words.size(), 5u);
  EXPECT_EQ(words[1], "0");
  EXPECT_EQ(words[2], "fault laser too hot");
  EXPECT_EQ(words[3], "gap 6 profiles lost, sequence 1 to 6");
  EXPECT_EQ(words[4], "7");
  EXPECT_EQ(scanner.counters().lost_profiles, 6u);
}

TEST_F(StreamScannerTest, ALostConnectionIsFinalUntilReopened) {
  StreamScanner scanner(options_);
  ASSERT_TRUE(scanner.Open());
  ASSERT_TRUE(scanner.Start());
  Trigger({{Kind::kCut, 1}});
  const auto words = ReadScan(scanner);
  EXPECT_NE(words.back().find("closed the connection"), std::string::npos) << words.back();
  hal::LaserProfile profile(200);
  hal::ScanEvent event;
  for (int i = 0; i < 2; ++i) {
    const auto again = scanner.Read(profile, event, milliseconds(1));
    ASSERT_FALSE(again);
    EXPECT_EQ(again.error().kind, hal::ErrorKind::kDevice);
  }
  ASSERT_TRUE(scanner.Open());
  ASSERT_TRUE(scanner.Start());
  Trigger();
  EXPECT_EQ(ReadScan(scanner), WholeScan());
}

TEST_F(StreamScannerTest, ASilentScannerIsATimeout) {
  StreamScanner scanner(options_);
  hal::LaserProfile profile(200);
  hal::ScanEvent event;
  EXPECT_FALSE(scanner.Read(profile, event, milliseconds(1)));  // not open
  ASSERT_TRUE(scanner.Open());
  EXPECT_FALSE(scanner.Read(profile, event, milliseconds(1)));  // not started
  ASSERT_TRUE(scanner.Start());
  for (int i = 0; i < 3; ++i) {
    const auto status = scanner.Read(profile, event, milliseconds(5));
    ASSERT_TRUE(status);
    EXPECT_EQ(*status, ReadStatus::kTimeout);
  }
}

// Its program hangs, but its kernel keeps the connection alive.
TEST_F(StreamScannerTest, ASilentScannerIsAskedAndThenGivenUp) {
  options_.patience = milliseconds(200);
  StreamScanner scanner(options_);
  ASSERT_TRUE(scanner.Open());
  ASSERT_TRUE(scanner.Start());
  hal::LaserProfile profile(200);
  hal::ScanEvent event;
  const nanoseconds until = clock_.Now() + 5 * options_.patience;
  while (clock_.Now() < until) {  // it answers, and that will do
    const auto status = scanner.Read(profile, event, milliseconds(10));
    ASSERT_TRUE(status) << status.error().message;
    EXPECT_EQ(*status, ReadStatus::kTimeout);
  }
  Device([&](SimulatedScanner&) {  // as long as this runs, it does nothing
    const auto words = ReadScan(scanner);
    EXPECT_NE(words.back().find("not even when asked who it is"), std::string::npos)
        << words.back();
    EXPECT_FALSE(scanner.Read(profile, event, milliseconds(1)));
  });
  // It has come to itself.
  ASSERT_TRUE(scanner.Open());
  ASSERT_TRUE(scanner.Start());
  Trigger();
  EXPECT_EQ(ReadScan(scanner), WholeScan());
}

TEST_F(StreamScannerTest, SilenceInTheMiddleOfAScanIsFoundToo) {
  options_.patience = milliseconds(50);
  StreamScanner scanner(options_);
  ASSERT_TRUE(scanner.Open());
  ASSERT_TRUE(scanner.Start());
  Trigger({{Kind::kRepeat, 1}, {Kind::kMute, 3'600'000}});
  const auto words = ReadScan(scanner);
  EXPECT_EQ(words.front(), "scan_start ");
  EXPECT_NE(words.back().find("not even when asked who it is"), std::string::npos) << words.back();
}

TEST_F(StreamScannerTest, SaysWhyItCannotConnect) {
  // The device serves one host: the second is turned away.
  StreamScanner first(options_);
  ASSERT_TRUE(first.Open());
  StreamScanner second(options_);
  EXPECT_FALSE(second.Open());
  options_.host = "no such host";
  StreamScanner lost(options_);
  const auto opened = lost.Open();
  ASSERT_FALSE(opened);
  EXPECT_NE(opened.error().message.find("no such host"), std::string::npos);
  EXPECT_EQ(opened.error().kind, hal::ErrorKind::kDevice);
  EXPECT_FALSE(lost.Start());
}

}  // namespace
}  // namespace bendloop::drivers
