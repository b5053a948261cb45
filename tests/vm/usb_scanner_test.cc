// SPDX-License-Identifier: Apache-2.0
//
// The USB scanner's driver over a real kernel's USB, with the software scanner as the device; run
// in a guest (usb_scanner.sh).
#include "drivers/usb_scanner/usb_scanner.h"

#include <gmock/gmock.h>

#include <cstdio>

#include "tests/support/child_process.h"
#include "tests/support/profile_source_conformance.h"

namespace bendloop::test {
namespace {

using drivers::UsbScanner;
using drivers::UsbScannerOptions;
using ::testing::HasSubstr;
using ::testing::StartsWith;

// bendloop-usbscanner on the guest's emulated device port.
class SoftwareScanner {
 public:
  SoftwareScanner()
      : process_({"bendloop-usbscanner", "--serial", "G1", "--pace", "max", "--max-points",
                  std::to_string(ReferenceScan::kPoints)}) {
    EXPECT_EQ(process_.ReadLine(), "listening G1");
  }
  ~SoftwareScanner() {
    process_.WriteLine("quit");
    EXPECT_EQ(process_.Wait(), 0);
  }
  void Scan() { process_.WriteLine("scan " + ReferenceScan::Get().session); }
  void Do(const std::string& command) { process_.WriteLine(command); }

 private:
  ChildProcess process_;
};

UsbScannerOptions Options() {
  UsbScannerOptions options;
  options.match.serial = "G1";
  options.arrival_timeout = std::chrono::seconds(10);
  return options;
}

class UsbUnderTest final : public SourceUnderTest {
 public:
  hal::ProfileSource& source() override { return source_; }
  void Scan() override { device_.Scan(); }

 private:
  SoftwareScanner device_;
  UsbScanner source_{Options()};
};

INSTANTIATE_TEST_SUITE_P(Kernel, ProfileSourceConformance,
                         ::testing::Values(SourceFactory{
                             "Usb", [] { return std::make_unique<UsbUnderTest>(); }}),
                         [](const auto& factory) { return factory.param.name; });

class UsbFaults : public ::testing::Test {
 protected:
  void OpenAndStart() {
    const auto opened = source_.Open();
    ASSERT_TRUE(opened) << opened.error().message;
    const auto started = source_.Start();
    ASSERT_TRUE(started) << started.error().message;
  }
  SoftwareScanner device_;
  UsbScanner source_{Options()};
};

TEST_F(UsbFaults, UnpluggedInTheMiddleAndPluggedInAgain) {
  for (const char* fault : {"unplug 50", "cut"}) {
    OpenAndStart();
    device_.Do("misbehave " + std::string(fault));
    device_.Scan();
    const auto items = ReadScan(source_);
    EXPECT_THAT(items.back(), StartsWith("error USB scanner 1209:0001 G1: ")) << fault;
    EXPECT_LT(items.size(), ReferenceItems().size());
  }
  OpenAndStart();
  device_.Scan();
  EXPECT_EQ(ReadScan(source_), ReferenceItems());
}

TEST_F(UsbFaults, HaltsAreCleared) {
  OpenAndStart();
  for (const char* fault : {"halt", "repeat", "halt", "repeat", "halt"}) {
    device_.Do("misbehave " + std::string(fault));
  }
  device_.Scan();
  EXPECT_EQ(ReadScan(source_), ReferenceItems());
  EXPECT_THAT(source_.Remarks(), HasSubstr("3 stalls, 2 profiles repeated"));
}

TEST_F(UsbFaults, GarbageFloodsLossAndRepeats) {
  OpenAndStart();
  for (const char* fault : {"repeat", "garbage 300000", "corrupt", "flood 2000", "gap 5"}) {
    device_.Do("misbehave " + std::string(fault));
  }
  device_.Scan();
  const auto items = ReadScan(source_);
  EXPECT_EQ(items.back(), ReferenceItems().back());
  EXPECT_EQ(source_.counters().lost_profiles, 4u);
  EXPECT_EQ(source_.counters().wire.payload_errors, 1u);
  EXPECT_EQ(source_.counters().repeated_profiles, 1999u);
}

// Printed, not judged: a machine may be busy. The fastest scanner sends about 12 MB/s.
TEST_F(UsbFaults, Throughput) {
  OpenAndStart();
  device_.Do("misbehave flood 16000 after 1");
  device_.Scan();
  EXPECT_EQ(ReadScan(source_, 2).size(), 2u);  // the device has the flood ready
  const hal::SteadyClock clock;
  const auto begun = clock.Now();
  const auto before = source_.counters().wire.bytes;
  EXPECT_EQ(ReadScan(source_).back(), ReferenceItems().back());
  const auto bytes = static_cast<double>(source_.counters().wire.bytes - before);
  const double seconds = std::chrono::duration<double>(clock.Now() - begun).count();
  std::printf("throughput through USB: %.1f MB in %.2f s, %.1f MB/s\n", bytes * 1e-6, seconds,
              bytes * 1e-6 / seconds);
}

TEST(UsbSilence, AMuteDeviceIsGivenUp) {
  SoftwareScanner device;
  UsbScannerOptions options = Options();
  options.patience = std::chrono::milliseconds(300);
  UsbScanner source(options);
  ASSERT_TRUE(source.Open());
  ASSERT_TRUE(source.Start());
  device.Do("misbehave mute 3600000");
  device.Scan();
  EXPECT_THAT(ReadScan(source).back(), HasSubstr("not even when asked"));
}

TEST(UsbMatching, NamesWhatIsThere) {
  UsbScannerOptions options = Options();
  options.arrival_timeout = std::chrono::nanoseconds(0);
  const auto nothing = UsbScanner(options).Open();
  ASSERT_FALSE(nothing);
  EXPECT_THAT(nothing.error().message, HasSubstr("is not plugged in; check its cable"));
  const SoftwareScanner device;
  UsbScanner first(Options());
  ASSERT_TRUE(first.Open());
  options.match.serial = "G2";
  const auto other = UsbScanner(options).Open();
  ASSERT_FALSE(other);
  EXPECT_THAT(other.error().message, HasSubstr("(but serial 'G1')"));
  options.match.serial.clear();
  const auto busy = UsbScanner(options).Open();
  ASSERT_FALSE(busy);
  EXPECT_THAT(busy.error().message, HasSubstr("is in use by another program"));
}

}  // namespace
}  // namespace bendloop::test
