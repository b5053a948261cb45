// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acquisition/acquisition.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <memory>
#include <random>
#include <thread>
#include <vector>

#include "fake_source.h"
#include "tests/support/call_guard.h"

namespace bendloop::host {
namespace {

using test::CallGuard;
using testing::FakeSource;
using namespace std::chrono_literals;

struct Seen {
  std::vector<std::uint64_t> sequences;
  std::vector<hal::ScanEventKind> events;
  std::uint64_t dropped = 0;
  SlotKind last = SlotKind::kProfile;
};

// Reads until the source has ended.
Seen Drain(ProfileRing& ring) {
  Seen seen;
  for (;;) {
    Slot* slot = ring.TakeWithin(10s);
    if (slot == nullptr) {
      ADD_FAILURE() << "nothing came for 10 s";
      return seen;
    }
    seen.dropped += slot->dropped_before;
    seen.last = slot->kind;
    if (slot->kind == SlotKind::kProfile) {
      // A slot must hold one profile whole.
      for (const auto& point : slot->profile.points) {
        EXPECT_EQ(point.x_mm, slot->profile.points.front().x_mm);
      }
      seen.sequences.push_back(slot->profile.sequence);
    }
    if (slot->kind == SlotKind::kEvent) seen.events.push_back(slot->event.kind);
    ring.Release();
    if (seen.last == SlotKind::kEnd || seen.last == SlotKind::kFault) return seen;
  }
}

TEST(ClockDrift, IsFoundUnderDelays) {
  for (const double ppm : {-200.0, -3.0, 0.0, 40.0, 5000.0}) {
    std::mt19937_64 engine(7);
    std::exponential_distribution<double> delay_ns(1.0 / 2e6);  // 2 ms, now and then 20
    ClockDrift drift;
    std::int64_t last = 0;
    for (int i = 0; i < 120'000; ++i) {  // two minutes
      const std::int64_t t_ns = 1'000'000LL * i;
      const auto device = static_cast<std::int64_t>(static_cast<double>(t_ns) * (1 + ppm * 1e-6));
      last = std::max(last, t_ns + static_cast<std::int64_t>(delay_ns(engine)));
      drift.Add(1'000'000'000'000 + device, last);
      if (i == 4000) {
        EXPECT_FALSE(drift.Ppm());
      }
      if (i == 10'000) {
        EXPECT_NEAR(drift.Ppm().value_or(1e9), ppm, 20) << "after 10 s";
      }
    }
    EXPECT_NEAR(drift.Ppm().value_or(1e9), ppm, 1);
  }
}

TEST(ClockDrift, ClocksThatAreSetAndNonsenseDoNoHarm) {
  ClockDrift drift;
  for (int i = 0; i < 10'000; ++i) drift.Add(1'000'000LL * i, 1'000'000LL * i);
  EXPECT_NEAR(drift.Ppm().value_or(1e9), 0, 0.01);
  drift.Add(0, 20'000'000'000);  // the scanner was switched off and on
  EXPECT_FALSE(drift.Ppm());
  for (int i = 0; i < 10'000; ++i) drift.Add(100'000LL * i, 1'000'000LL * i);  // ten times slower
  EXPECT_FALSE(drift.Ppm());
  for (const std::int64_t t : {INT64_MIN, INT64_MIN + 1, std::int64_t{0}, INT64_MAX}) {
    drift.Add(t, 0);
    drift.Add(t, INT64_MAX);
    drift.Add(t, INT64_MIN);
    (void)drift.Ppm();
  }
}

TEST(Acquisition, ARecordingLosesNothingThroughATinyRing) {
  FakeSource source;
  source.is_live = false;
  source.count = 20000;
  ProfileRing ring(2, source.points);
  hal::SteadyClock clock;
  Acquisition acquisition(source, source.info(), ring, clock, {});
  ASSERT_TRUE(acquisition.Start());
  const Seen seen = Drain(ring);
  acquisition.Stop();
  ASSERT_EQ(seen.sequences.size(), source.count);
  for (std::uint64_t i = 0; i < source.count; ++i) ASSERT_EQ(seen.sequences[i], i);
  EXPECT_EQ(seen.dropped, 0u);
  EXPECT_EQ(acquisition.counters().dropped_profiles, 0u);
  EXPECT_EQ(acquisition.counters().points, source.count * source.points);
  EXPECT_TRUE(source.stopped);
}

TEST(Acquisition, ALiveSourceDropsAndMarksTheGapWhenNobodyReads) {
  FakeSource source;
  source.count = 1000;
  ProfileRing ring(16, source.points);
  hal::ManualClock clock;
  Acquisition acquisition(source, source.info(), ring, clock, {});
  std::thread writer([&] { acquisition.Run(); });
  while (acquisition.counters().events < 2) std::this_thread::yield();  // scan_end came through
  const Seen seen = Drain(ring);
  writer.join();
  EXPECT_LT(seen.sequences.size(), 1000u);
  EXPECT_GE(seen.sequences.size(), 15u);
  EXPECT_EQ(seen.sequences.size() + seen.dropped, 1000u);
  EXPECT_EQ(acquisition.counters().dropped_profiles, seen.dropped);
  EXPECT_THAT(seen.events,
              ::testing::ElementsAre(hal::ScanEventKind::kScanStart, hal::ScanEventKind::kScanEnd));
  EXPECT_GE(acquisition.counters().queue_peak, 15u);
}

TEST(Acquisition, CountsWhatTheScannerItselfLost) {
  FakeSource source;
  source.is_live = false;
  source.skip_at = 40;
  ProfileRing ring(256, source.points);
  hal::ManualClock clock;
  Acquisition acquisition(source, source.info(), ring, clock, {});
  acquisition.Run();
  EXPECT_EQ(acquisition.counters().missing_profiles, 3u);
}

TEST(Acquisition, TellsTheReaderWhyTheSourceFailed) {
  FakeSource source;
  source.fail_at = 5;
  ProfileRing ring(64, source.points);
  hal::ManualClock clock;
  Acquisition acquisition(source, source.info(), ring, clock, {});
  ASSERT_TRUE(acquisition.Start());
  const Seen seen = Drain(ring);
  EXPECT_EQ(seen.last, SlotKind::kFault);
  EXPECT_EQ(seen.sequences.size(), 5u);
  EXPECT_EQ(acquisition.fault().kind, hal::ErrorKind::kDevice);
}

TEST(Acquisition, MeasuresLatenessAgainstTheQuickestProfileOfTheScan) {
  FakeSource source;
  source.count = 3;  // exposures at 0, 1000, 2000 ns on a host clock that stands still
  ProfileRing ring(64, source.points);
  hal::ManualClock clock;
  Acquisition acquisition(source, source.info(), ring, clock, {});
  acquisition.Run();
  // Delays 0, -1000, -2000: each the quickest so far.
  EXPECT_EQ(acquisition.counters().lateness_peak_ns, 0);
}

// A damaged device may give any times.
TEST(Acquisition, TimesAtTheEndsOfTheirRangeAreLateAndNotEarly) {
  FakeSource source;
  source.times_ns = {INT64_MAX, 0, INT64_MIN, INT64_MIN + 1, -1};
  source.count = source.times_ns.size();
  ProfileRing ring(64, source.points);
  hal::ManualClock clock;
  clock.Advance(std::chrono::nanoseconds(1000));
  Acquisition acquisition(source, source.info(), ring, clock, {});
  acquisition.Run();
  // Delays 1000 - INT64_MAX, 1000, then more than there are numbers for.
  EXPECT_EQ(acquisition.counters().lateness_peak_ns, INT64_MAX);
  EXPECT_EQ(acquisition.counters().lateness_last_ns, INT64_MAX);
  EXPECT_EQ(acquisition.counters().profiles, source.count);
}

TEST(Acquisition, StopsWhileARecordingWaitsForRoom) {
  FakeSource source;
  source.is_live = false;
  source.count = 100000;
  ProfileRing ring(4, source.points);
  hal::SteadyClock clock;
  Acquisition acquisition(source, source.info(), ring, clock, {});
  ASSERT_TRUE(acquisition.Start());
  while (ring.Filled() < 4) std::this_thread::yield();
  acquisition.Stop();
  EXPECT_TRUE(source.stopped);
}

TEST(AcquisitionLoop, AllocatesNothingAndTakesNoLock) {
  if (!CallGuard::works()) GTEST_SKIP() << "the sanitizer owns malloc in this build";
  for (const bool is_live : {true, false}) {
    FakeSource source;
    source.is_live = is_live;
    source.count = 5000;
    ProfileRing ring(32, source.points);
    hal::SteadyClock clock;
    Acquisition acquisition(source, source.info(), ring, clock, {});
    std::uint64_t allocations = 1;
    std::uint64_t locks = 1;
    std::thread writer([&] {
      CallGuard guard;
      acquisition.Run();
      allocations = CallGuard::allocations();
      locks = CallGuard::locks();
    });
    Drain(ring);
    writer.join();
    EXPECT_EQ(allocations, 0u) << (is_live ? "live" : "recording");
    EXPECT_EQ(locks, 0u) << (is_live ? "live" : "recording");
  }
}

TEST(AcquisitionLoop, TheGuardSeesAllocationsAndLocks) {
  if (!CallGuard::works()) GTEST_SKIP() << "the sanitizer owns malloc in this build";
  pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
  CallGuard guard;
  void* volatile memory = std::malloc(100);
  std::free(memory);
  auto number = std::make_unique<std::vector<int>>(10);
  pthread_mutex_lock(&mutex);
  pthread_mutex_unlock(&mutex);
  EXPECT_GE(CallGuard::allocations(), 3u);
  EXPECT_EQ(CallGuard::locks(), 1u);
}

// One that goes by the wall clock hangs for a year when somebody sets it back by a year.
TEST(ProfileRing, WaitsByAClockThatNobodySets) {
  if (!CallGuard::works()) GTEST_SKIP() << "the sanitizer stands before the C library";
  ProfileRing ring(2, 1);
  const CallGuard guard;
  EXPECT_EQ(ring.TakeWithin(1ms), nullptr);
  while (ring.PublishWithin(1ms)) {
  }
  EXPECT_NE(ring.TakeWithin(1ms), nullptr);
  EXPECT_EQ(CallGuard::wall_clock_waits(), 0u);
}

TEST(Realtime, IsAskedForOnlyWhenConfigured) {
  const auto note = ApplyRealtime({});
  ASSERT_TRUE(note);
  EXPECT_EQ(*note, "");
}

TEST(Realtime, RequiredButImpossibleIsADeviceErrorThatNamesTheCause) {
  std::thread other([] {  // affinity belongs to the thread
    RealtimePolicy policy;
    policy.enabled = true;
    policy.required = true;
    policy.cpu = 1023;  // no such CPU
    const auto applied = ApplyRealtime(policy);
    ASSERT_FALSE(applied);
    EXPECT_EQ(applied.error().kind, hal::ErrorKind::kDevice);
    EXPECT_THAT(applied.error().message, ::testing::HasSubstr("CPU 1023"));
  });
  other.join();
}

}  // namespace
}  // namespace bendloop::host
