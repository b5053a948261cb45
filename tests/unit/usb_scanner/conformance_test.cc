// SPDX-License-Identifier: Apache-2.0
//
// Every ProfileSource passes the same suite; the USB scanner once more in the guest (tests/vm).
#include <atomic>
#include <mutex>
#include <thread>

#include "drivers/simulated_scanner/simulated_scanner.h"
#include "drivers/stream_scanner/stream_scanner.h"
#include "drivers/usb_scanner/usb_scanner.h"
#include "fake_usb_port.h"
#include "tests/support/profile_source_conformance.h"

namespace bendloop::test {
namespace {

using namespace drivers;

std::unique_ptr<hal::ProfileSource> OpenReference(hal::Clock& clock) {
  auto session =
      std::make_unique<SessionSource>(ReferenceScan::Get().session, ReplayPace::kMax, clock);
  EXPECT_TRUE(session->Open());
  EXPECT_TRUE(session->Start());
  return session;
}

class RecordingUnderTest final : public SourceUnderTest {
 public:
  hal::ProfileSource& source() override { return source_; }
  bool is_live() const override { return false; }

 private:
  hal::SteadyClock clock_;
  SessionSource source_{ReferenceScan::Get().session, ReplayPace::kMax, clock_};
};

// Over TCP, from the simulated scanner: the scan made as it runs, or played from its recording.
class StreamUnderTest final : public SourceUnderTest {
 public:
  explicit StreamUnderTest(bool simulates) : simulates_(simulates) {
    auto made =
        SimulatedScanner::Listen(0, {"sim", "S1", "1.0", "cal", ReferenceScan::kPoints}, clock_);
    EXPECT_TRUE(made);
    device_ = std::move(*made);
    StreamScannerOptions options;
    options.port = device_->port();
    options.settings = WireSettings{};
    source_ = std::make_unique<StreamScanner>(options);
    thread_ = std::thread([this] {
      while (!stop_) {
        while (wanted_) std::this_thread::yield();  // a mutex alone may starve who waits for it
        const std::lock_guard lock(mutex_);
        EXPECT_TRUE(device_->Poll(std::chrono::milliseconds(1)));
      }
    });
  }
  ~StreamUnderTest() override {
    stop_ = true;
    thread_.join();
  }
  hal::ProfileSource& source() override { return *source_; }
  void Scan() override {
    wanted_ = true;
    const std::lock_guard lock(mutex_);
    wanted_ = false;
    const ReferenceScan& scan = ReferenceScan::Get();
    if (simulates_) {
      device_->Trigger(std::make_shared<const VirtualScan>(scan.tube, scan.options),
                       ScanPace::kMax);
    } else {
      device_->device().Trigger(OpenReference(clock_), ScanPace::kRealTime);
    }
  }

 private:
  const bool simulates_;
  hal::SteadyClock clock_;
  std::unique_ptr<SimulatedScanner> device_;
  std::unique_ptr<StreamScanner> source_;
  std::mutex mutex_;
  std::atomic<bool> stop_{false};
  std::atomic<bool> wanted_{false};
  std::thread thread_;
};

class FakeUsbUnderTest final : public SourceUnderTest {
 public:
  hal::ProfileSource& source() override { return source_; }
  void Scan() override {
    bus_.WithDevice(
        [this](ScannerDevice& device) { device.Trigger(OpenReference(clock_), ScanPace::kMax); });
  }
  ~FakeUsbUnderTest() override {
    const std::lock_guard lock(bus_.mutex);
    EXPECT_EQ(bus_.wrong, std::vector<std::string>());
  }

 private:
  hal::SteadyClock clock_;
  FakeBus bus_{clock_};
  UsbScanner source_{UsbScannerOptions{}, std::make_unique<FakeUsbPort>(bus_)};
};

INSTANTIATE_TEST_SUITE_P(
    All, ProfileSourceConformance,
    ::testing::Values(
        SourceFactory{"Session", [] { return std::make_unique<RecordingUnderTest>(); }},
        SourceFactory{"Simulated", [] { return std::make_unique<StreamUnderTest>(true); }},
        SourceFactory{"Stream", [] { return std::make_unique<StreamUnderTest>(false); }},
        SourceFactory{"UsbWithoutHardware", [] { return std::make_unique<FakeUsbUnderTest>(); }}),
    [](const auto& factory) { return factory.param.name; });

}  // namespace
}  // namespace bendloop::test
