// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <string>

#include "hal/clock.h"
#include "hal/profile_source.h"
#include "tests/support/call_guard.h"
#include "tests/support/reference_scan.h"

// What every hal::ProfileSource must do, whatever is behind it. A program that includes this
// instantiates ProfileSourceConformance with its own sources.
namespace bendloop::test {

// A source and the device behind it.
class SourceUnderTest {
 public:
  virtual ~SourceUnderTest() = default;
  virtual hal::ProfileSource& source() = 0;
  virtual bool is_live() const { return true; }
  // The device plays the reference scan once, as soon as it is started. A recording does so anyhow.
  virtual void Scan() {}
};

struct SourceFactory {
  std::string name;
  std::function<std::unique_ptr<SourceUnderTest>()> make;
};

class ProfileSourceConformance : public ::testing::TestWithParam<SourceFactory> {
 protected:
  ProfileSourceConformance() : under_test_(GetParam().make()), source_(under_test_->source()) {}
  void OpenAndStart() {
    const auto info = source_.Open();
    ASSERT_TRUE(info) << info.error().message;
    EXPECT_EQ(info->is_live, under_test_->is_live());
    EXPECT_FALSE(info->model.empty());
    EXPECT_GE(info->max_points, under_test_->is_live() ? ReferenceScan::kPoints : 1);
    const auto started = source_.Start();
    ASSERT_TRUE(started) << started.error().message;
  }

  std::unique_ptr<SourceUnderTest> under_test_;
  hal::ProfileSource& source_;
};

TEST_P(ProfileSourceConformance, DeliversTheScanBitForBitAgainAndAgain) {
  ASSERT_GT(ReferenceItems().size(), 50u);
  for (int round = 0; round < 2; ++round) {
    OpenAndStart();
    under_test_->Scan();
    EXPECT_EQ(ReadScan(source_), ReferenceItems());
    if (under_test_->is_live()) {  // stays open for another start
      source_.Stop();
      ASSERT_TRUE(source_.Start());
      under_test_->Scan();
      EXPECT_EQ(ReadScan(source_), ReferenceItems());
    }
    source_.Stop();
    EXPECT_EQ(source_.Remarks(), "");
  }
}

TEST_P(ProfileSourceConformance, BeginsAnewWhenOpenedInTheMiddle) {
  OpenAndStart();
  under_test_->Scan();
  EXPECT_EQ(ReadScan(source_, 20).size(), 20u);
  OpenAndStart();
  under_test_->Scan();
  EXPECT_EQ(ReadScan(source_), ReferenceItems());
}

TEST_P(ProfileSourceConformance, SaysWhenItIsNotOpen) {
  hal::LaserProfile profile(ReferenceScan::kPoints);
  hal::ScanEvent event;
  EXPECT_FALSE(source_.Start());
  EXPECT_FALSE(source_.Read(profile, event, std::chrono::milliseconds(1)));
  source_.Stop();
}

TEST_P(ProfileSourceConformance, KeepsToTheTimeout) {
  if (!under_test_->is_live()) return;
  OpenAndStart();
  hal::LaserProfile profile(ReferenceScan::kPoints);
  hal::ScanEvent event;
  for (const auto timeout : {std::chrono::milliseconds(0), std::chrono::milliseconds(5)}) {
    const auto status = source_.Read(profile, event, timeout);
    ASSERT_TRUE(status) << status.error().message;
    EXPECT_EQ(*status, hal::ReadStatus::kTimeout);
  }
}

// For the acquisition thread: as hal/profile_source.h has it.
TEST_P(ProfileSourceConformance, ReadsWithoutAllocationsAndLocks) {
  if (!under_test_->is_live() || !CallGuard::works()) return;
  OpenAndStart();
  under_test_->Scan();
  hal::LaserProfile profile(ReferenceScan::kPoints);
  hal::ScanEvent event;
  const auto* const storage = profile.points.data();
  const hal::SteadyClock clock;
  const auto deadline = clock.Now() + std::chrono::seconds(60);
  bool ended = false;
  {
    const CallGuard guard;
    while (!ended && clock.Now() < deadline) {
      const auto status = source_.Read(profile, event, std::chrono::milliseconds(50));
      ended = !status ||
              (*status == hal::ReadStatus::kEvent && event.kind == hal::ScanEventKind::kScanEnd);
    }
  }
  EXPECT_TRUE(ended);
  EXPECT_EQ(CallGuard::allocations(), 0u);
  EXPECT_EQ(CallGuard::locks(), 0u);
  EXPECT_EQ(profile.points.data(), storage);
}

}  // namespace bendloop::test
