// SPDX-License-Identifier: Apache-2.0
//
// What the driver does when USB goes wrong, without hardware.
#include "drivers/usb_scanner/usb_scanner.h"

#include <gmock/gmock.h>

#include "fake_usb_port.h"
#include "tests/support/reference_scan.h"

namespace bendloop::drivers {
namespace {

using test::ReadScan;
using test::ReferenceItems;
using test::ReferenceScan;
using ::testing::HasSubstr;
using Fault = FakeBus::Fault;
using Kind = ScannerFault::Kind;
using std::chrono::milliseconds;

class UsbScannerTest : public ::testing::Test {
 protected:
  void TearDown() override {
    scanner_.reset();
    EXPECT_EQ(bus_.wrong, std::vector<std::string>());
  }
  UsbScanner& Open() {
    auto port = std::make_unique<FakeUsbPort>(bus_);
    scanner_ = std::make_unique<UsbScanner>(options_, std::move(port));
    const auto opened = scanner_->Open();
    EXPECT_TRUE(opened) << opened.error().message;
    const auto started = scanner_->Start();
    EXPECT_TRUE(started) << started.error().message;
    return *scanner_;
  }
  void Scan(std::initializer_list<ScannerFault> misbehaviours = {}) {
    auto session =
        std::make_unique<SessionSource>(ReferenceScan::Get().session, ReplayPace::kMax, clock_);
    ASSERT_TRUE(session->Open());
    bus_.WithDevice([&](ScannerDevice& device) {
      for (const auto& one : misbehaviours) device.Misbehave(one);
      device.Trigger(std::move(session), ScanPace::kMax);
    });
  }

  hal::SteadyClock clock_;
  FakeBus bus_{clock_};
  UsbScannerOptions options_;
  std::unique_ptr<UsbScanner> scanner_;
};

TEST_F(UsbScannerTest, KeepsSeveralTransfersInFlight) {
  options_.transfers = 8;
  UsbScanner& scanner = Open();
  Scan();
  EXPECT_EQ(ReadScan(scanner), ReferenceItems());
  EXPECT_EQ(bus_.most_in_flight, 8u);
}

TEST_F(UsbScannerTest, ADeviceClockMayBeFast) {
  UsbScanner& scanner = Open();
  bus_.WithDevice([](ScannerDevice& device) { device.set_clock_drift_ppm(1000); });
  Scan();
  const auto items = ReadScan(scanner);
  ASSERT_EQ(items.size(), ReferenceItems().size());
  // The fifth profile, 0.25 ms apart, a thousandth more.
  EXPECT_THAT(items[5], HasSubstr("profile 4 at 1001001000"));
}

TEST_F(UsbScannerTest, OneTransferIsEnough) {
  options_.transfers = 1;
  UsbScanner& scanner = Open();
  Scan();
  EXPECT_EQ(ReadScan(scanner), ReferenceItems());
}

TEST_F(UsbScannerTest, ClearsHaltsAndOutlivesErrorsAndEmptyPackets) {
  UsbScanner& scanner = Open();
  for (int after = 5; after < 100; after += 10) bus_.Plan(Fault::kStall, after);
  for (const int after : {17, 27, 27, 27, 60}) bus_.Plan(Fault::kError, after);
  bus_.Plan(Fault::kEmpty, 30, 50);
  Scan();
  EXPECT_EQ(ReadScan(scanner), ReferenceItems());  // a halt between transfers costs nothing
  EXPECT_EQ(bus_.halts_cleared, 15);
  EXPECT_EQ(scanner.Remarks(), "10 stalls, 5 USB errors");
}

TEST_F(UsbScannerTest, AHaltMayEndAllTransfers) {
  bus_.stalls_all = true;
  UsbScanner& scanner = Open();
  bus_.Plan(Fault::kStall, 5);
  bus_.Plan(Fault::kStall, 100);
  Scan();
  EXPECT_EQ(ReadScan(scanner), ReferenceItems());
  EXPECT_EQ(scanner.Remarks(), "2 stalls");
}

TEST_F(UsbScannerTest, GivesUpOnAPipeThatOnlyStalls) {
  UsbScanner& scanner = Open();
  bus_.Plan(Fault::kStall, 0, 1000);
  Scan();
  EXPECT_THAT(ReadScan(scanner).back(), HasSubstr("USB scanner 1209:0001 F1: stalls again"));
  EXPECT_LT(bus_.halts_cleared, 100);
}

TEST_F(UsbScannerTest, GivesUpOnABusThatOnlyFails) {
  UsbScanner& scanner = Open();
  bus_.Plan(Fault::kError, 0, 1000);
  Scan();
  EXPECT_THAT(ReadScan(scanner).back(), HasSubstr("try another cable or port"));
}

TEST_F(UsbScannerTest, AnUnpluggedOneIsLostUntilOpenedAgain) {
  UsbScanner& scanner = Open();
  bus_.Plan(Fault::kGone, 40);
  Scan();
  const auto items = ReadScan(scanner);
  EXPECT_EQ(items.back(), "error USB scanner 1209:0001 F1: was unplugged");
  EXPECT_EQ(ReadScan(scanner), std::vector<std::string>{items.back()});
  EXPECT_FALSE(scanner.Start());
  const auto reopened = scanner.Open();
  ASSERT_FALSE(reopened);
  EXPECT_THAT(reopened.error().message, HasSubstr("not plugged in"));
  bus_.WithDevice([&](ScannerDevice&) { bus_.plugged = true; });
  ASSERT_TRUE(scanner.Open());
  ASSERT_TRUE(scanner.Start());
  Scan();
  EXPECT_EQ(ReadScan(scanner), ReferenceItems());
}

TEST_F(UsbScannerTest, FindsItsWayAfterGarbageLossAndRepeats) {
  UsbScanner& scanner = Open();
  Scan({{Kind::kRepeat, 1},
        {Kind::kGarbage, 100'000},
        {Kind::kCorrupt, 1},
        {Kind::kBadPose, 1},
        {Kind::kFlood, 5000},
        {Kind::kGap, 5}});
  const auto items = ReadScan(scanner);
  // 0 came whole, its repeat damaged; 1 was spoilt, 2 came 5000 times, 3 to 6 were left out.
  ASSERT_GT(items.size(), 4u);
  EXPECT_EQ(items[1], ReferenceItems()[1]);
  EXPECT_THAT(items[2], HasSubstr("gap"));
  EXPECT_EQ(items.back(), ReferenceItems().back());
  const WireScannerCounters seen = scanner.counters();
  EXPECT_EQ(seen.lost_profiles, 5u);
  EXPECT_EQ(seen.repeated_profiles, 4999u);
  EXPECT_EQ(seen.wire.payload_errors, 1u);
  EXPECT_EQ(seen.bad_messages, 1u);
  EXPECT_EQ(seen.wire.repeated_sequences, 4999u);
  EXPECT_THAT(scanner.Remarks(), HasSubstr("5 profiles lost"));
}

// A device that a dead host has left in the middle of a scan.
TEST_F(UsbScannerTest, AnswersToAnotherHostAreNotTakenForOurs) {
  {
    UsbScanner& first = Open();
    Scan();
    EXPECT_EQ(ReadScan(first, 10).size(), 10u);
    // It goes away without a word: the device's bytes stay where they are.
    bus_.WithDevice([&](ScannerDevice&) { bus_.takes_requests = false; });
    scanner_.reset();
    bus_.WithDevice([&](ScannerDevice&) { bus_.takes_requests = true; });
  }
  UsbScanner& second = Open();
  EXPECT_GT(second.counters().stale_messages, 0u);
  Scan();
  EXPECT_EQ(ReadScan(second), ReferenceItems());
}

TEST_F(UsbScannerTest, ASilentDeviceIsAskedAndThenGivenUp) {
  options_.patience = milliseconds(50);
  UsbScanner& scanner = Open();
  hal::LaserProfile profile(200);
  hal::ScanEvent event;
  const auto until = clock_.Now() + milliseconds(500);
  while (clock_.Now() < until) {  // it answers, and that will do
    const auto status = scanner.Read(profile, event, milliseconds(10));
    ASSERT_TRUE(status) << status.error().message;
    EXPECT_EQ(*status, hal::ReadStatus::kTimeout);
  }
  Scan({{Kind::kMute, 3'600'000}});
  EXPECT_THAT(ReadScan(scanner).back(), HasSubstr("not even when asked"));
}

TEST_F(UsbScannerTest, ADeviceThatAnswersNothingDoesNotOpen) {
  options_.answer_timeout = milliseconds(30);
  bus_.takes_requests = false;
  UsbScanner scanner(options_, std::make_unique<FakeUsbPort>(bus_));
  const auto opened = scanner.Open();
  ASSERT_FALSE(opened);
  EXPECT_THAT(opened.error().message, HasSubstr("takes no requests"));
}

TEST_F(UsbScannerTest, AFloodStaysBounded) {
  options_.transfers = 4;
  UsbScanner& scanner = Open();
  Scan({{Kind::kGarbage, 1'000'000}});
  // The reader sleeps: the device waits, with no more than the transfers filled.
  int filled = -1;
  const auto deadline = clock_.Now() + std::chrono::seconds(20);
  for (int now = 0; filled != now && clock_.Now() < deadline;) {
    filled = now;
    std::this_thread::yield();
    const auto until = clock_.Now() + milliseconds(20);
    while (clock_.Now() < until) std::this_thread::yield();
    const std::lock_guard lock(bus_.mutex);
    now = bus_.filled;
  }
  EXPECT_LE(filled, 12);  // with those of identify and start
  // While garbage keeps coming each read still ends in time.
  hal::LaserProfile profile(200);
  hal::ScanEvent event;
  const auto status = scanner.Read(profile, event, milliseconds(0));
  EXPECT_TRUE(status);
  EXPECT_EQ(ReadScan(scanner).back(), ReferenceItems().back());
}

}  // namespace
}  // namespace bendloop::drivers
