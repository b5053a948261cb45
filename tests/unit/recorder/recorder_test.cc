// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/recorder/recorder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <condition_variable>
#include <fstream>
#include <mutex>
#include <new>
#include <thread>

#include "drivers/session/session_reader.h"
#include "tests/support/hand_clock.h"
#include "tests/support/recorded_profiles.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;
using test::NumberedProfile;

class RecorderTest : public ::testing::Test {
 protected:
  static hal::ScanEvent Event(hal::ScanEventKind kind) {
    hal::ScanEvent event;
    event.kind = kind;
    return event;
  }
  std::size_t ProfilesOf(const fs::path& path) {
    auto reader = drivers::SessionReader::Open(path.string());
    EXPECT_TRUE(reader) << reader.error().message;
    if (!reader) return 0;
    hal::LaserProfile profile(reader->max_points());
    std::size_t count = 0;
    while (reader->NextProfile(profile).value_or(false)) ++count;
    meta_ = reader->meta();
    events_.clear();
    hal::ScanEvent event;
    while (reader->NextEvent(event).value_or(false)) events_.emplace_back(event.detail());
    return count;
  }

  hal::SteadyClock clock_;
  test::RecordingFolder folder_;
  const fs::path& directory_ = folder_.path();
  std::map<std::string, std::string> meta_;
  std::vector<std::string> events_;  // their details
};

TEST_F(RecorderTest, WritesWhatItWasGiven) {
  Recorder recorder({directory_}, clock_);
  recorder.Begin("part-0001", {{"part", "elbow"}});
  recorder.Add(Event(hal::ScanEventKind::kScanStart));
  for (std::uint64_t i = 0; i < 500; ++i) recorder.Add(NumberedProfile(i));
  recorder.Add(Event(hal::ScanEventKind::kScanEnd));
  recorder.Finish({{"context", "{}"}});
  recorder.Flush();
  EXPECT_EQ(ProfilesOf(recorder.PathOf("part-0001")), 500u);
  EXPECT_EQ(meta_["part"], "elbow");
  EXPECT_EQ(meta_["context"], "{}");
  EXPECT_EQ(meta_["recording"], "complete");
  EXPECT_EQ(recorder.counters().profiles, 500u);
  EXPECT_EQ(recorder.counters().queued_points, 0u);
  EXPECT_EQ(recorder.counters().last_error, "");
}

TEST_F(RecorderTest, LeavesOutWhatDoesNotFitAndSaysSo) {
  RecorderOptions options{directory_};
  options.queue_points = 15;  // never room for two profiles at once
  Recorder recorder(options, clock_);
  recorder.Begin("part-0001", {});
  recorder.Add(NumberedProfile(0, 20));  // never fits
  recorder.Flush();
  recorder.Add(NumberedProfile(1, 10));
  recorder.Finish({});
  recorder.Flush();
  EXPECT_EQ(ProfilesOf(recorder.PathOf("part-0001")), 1u);
  EXPECT_EQ(meta_["recording"], "incomplete");
  EXPECT_EQ(recorder.counters().dropped_profiles, 1u);
}

TEST_F(RecorderTest, WhatIsLeftOutAtTheEndIsMarkedToo) {
  RecorderOptions options{directory_};
  options.queue_points = 15;
  Recorder recorder(options, clock_);
  recorder.Begin("part-0001", {});
  recorder.Add(NumberedProfile(0));
  recorder.Flush();
  recorder.Add(NumberedProfile(1, 20));
  recorder.Add(NumberedProfile(2, 20));
  recorder.Finish({});
  recorder.Begin("part-0002", {});  // its own gaps only
  recorder.Add(NumberedProfile(0));
  recorder.Finish({});
  recorder.Flush();
  EXPECT_EQ(ProfilesOf(recorder.PathOf("part-0001")), 1u);
  EXPECT_EQ(meta_["recording"], "incomplete");
  EXPECT_THAT(events_, ::testing::ElementsAre("lost 2 profiles: the disk was too slow for the "
                                              "recorder"));
  EXPECT_EQ(ProfilesOf(recorder.PathOf("part-0002")), 1u);
  EXPECT_EQ(meta_["recording"], "complete");
  EXPECT_THAT(recorder.counters().last_error, ::testing::HasSubstr("too slow"));
}

// A disk that hangs as soon as a file is opened, for whoever opens one by SQLite's default way.
class HangingDisk {
 public:
  HangingDisk() : real_(sqlite3_vfs_find(nullptr)), hanging_(*real_) {
    its_ = this;
    hanging_.zName = "hanging";
    hanging_.xOpen = [](sqlite3_vfs*, const char* name, sqlite3_file* file, int flags, int* out) {
      std::unique_lock lock(its_->mutex_);
      its_->is_waited_for_ = true;
      its_->changed_.notify_all();
      its_->changed_.wait(lock, [] { return its_->works_; });
      return its_->real_->xOpen(its_->real_, name, file, flags, out);
    };
    sqlite3_vfs_register(&hanging_, 1);
  }
  ~HangingDisk() {
    sqlite3_vfs_register(real_, 1);
    sqlite3_vfs_unregister(&hanging_);
  }
  void AwaitHang() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return is_waited_for_; });
  }
  void Work() {
    const std::lock_guard lock(mutex_);
    works_ = true;
    changed_.notify_all();
  }

 private:
  static inline HangingDisk* its_ = nullptr;
  sqlite3_vfs* const real_;
  sqlite3_vfs hanging_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool is_waited_for_ = false;
  bool works_ = false;
};

TEST_F(RecorderTest, NothingGrowsWithoutEndWhileTheDiskHangs) {
  HangingDisk disk;
  RecorderOptions options{directory_};
  options.queue_items = 100;
  Recorder recorder(options, clock_);
  recorder.Begin("part-0000", {});
  disk.AwaitHang();
  EXPECT_FALSE(recorder.FlushWithin(std::chrono::nanoseconds(0)));
  // A storm of profiles without points and of events, then many scans of them.
  for (std::uint64_t i = 0; i < 5000; ++i) recorder.Add(NumberedProfile(i, 0));
  EXPECT_EQ(recorder.counters().dropped_profiles, 4900u);
  EXPECT_EQ(recorder.counters().queued_items, 100u);
  for (int i = 0; i < 5000; ++i) recorder.Add(Event(hal::ScanEventKind::kButton));
  EXPECT_LT(recorder.counters().queued_items, 2000u);
  recorder.Finish({});
  for (int part = 1; part <= 3000; ++part) {
    recorder.Begin("part-" + std::to_string(part), {{"context", std::string(1000, 'x')}});
    for (std::uint64_t i = 0; i < 5; ++i) recorder.Add(NumberedProfile(i, 0));
    recorder.Add(Event(hal::ScanEventKind::kScanEnd));
    if (part % 2 == 0) recorder.Discard();
    recorder.Finish({});
    recorder.Finish({});
  }
  const RecorderCounters hung = recorder.counters();
  EXPECT_LT(hung.queued_items, 2000u);
  EXPECT_GT(hung.dropped_events, 3000u);
  EXPECT_EQ(hung.dropped_sessions, 3000u - 64);
  EXPECT_EQ(hung.dropped_profiles, 4900u + 5 * 3000);
  EXPECT_THAT(hung.last_error, ::testing::HasSubstr("part-3000"));
  EXPECT_THAT(hung.last_error, ::testing::HasSubstr("hangs"));

  disk.Work();
  recorder.Flush();
  EXPECT_EQ(ProfilesOf(recorder.PathOf("part-0000")), 100u);
  EXPECT_EQ(meta_["recording"], "incomplete");
  EXPECT_THAT(events_, ::testing::Contains(::testing::HasSubstr("lost 4900 profiles")));
  EXPECT_FALSE(fs::exists(recorder.PathOf("part-2999")));
  // And goes on as before.
  recorder.Begin("part-4000", {});
  recorder.Add(NumberedProfile(0));
  recorder.Finish({});
  recorder.Flush();
  EXPECT_EQ(ProfilesOf(recorder.PathOf("part-4000")), 1u);
  EXPECT_EQ(meta_["recording"], "complete");
}

TEST_F(RecorderTest, AScansEndGetsThroughWhereItsProfilesDoNot) {
  HangingDisk disk;
  RecorderOptions options{directory_};
  options.queue_items = 10;
  Recorder recorder(options, clock_);
  recorder.Begin("part-0001", {});
  disk.AwaitHang();
  for (std::uint64_t i = 0; i < 50; ++i) recorder.Add(NumberedProfile(i));
  hal::ScanEvent end = Event(hal::ScanEventKind::kScanEnd);
  end.t_ns = 50'000;
  end.set_detail("the end");
  recorder.Add(end);
  recorder.Finish({});
  disk.Work();
  recorder.Flush();
  EXPECT_EQ(ProfilesOf(recorder.PathOf("part-0001")), 10u);
  EXPECT_THAT(events_, ::testing::ElementsAre(::testing::HasSubstr("lost 40 profiles"), "the end"));
}

// What a reader finds is what a power cut leaves: the file is not finished, no clock has gone on.
TEST_F(RecorderTest, TheFirstProfileIsSafeAtOnce) {
  tests::HandClock still;
  Recorder recorder({directory_}, still);
  recorder.Begin("part-0001", {});
  recorder.Add(NumberedProfile(0));
  recorder.Flush();
  EXPECT_EQ(ProfilesOf(recorder.PathOf("part-0001")), 1u);
}

TEST_F(RecorderTest, LaterProfilesAreSafeAQuarterSecondAfterTheyCame) {
  tests::HandClock clock;
  Recorder recorder({directory_}, clock);
  const auto safe = [&] {
    recorder.Flush();
    return ProfilesOf(recorder.PathOf("part-0001"));
  };
  recorder.Begin("part-0001", {});
  recorder.Add(NumberedProfile(0));
  EXPECT_EQ(safe(), 1u);
  recorder.Add(NumberedProfile(1));
  EXPECT_EQ(safe(), 1u) << "not a sync for each profile";
  clock.Advance(std::chrono::milliseconds(250));
  recorder.Add(NumberedProfile(2));
  EXPECT_EQ(safe(), 3u);
}

TEST_F(RecorderTest, WhatWaitedForTheDiskIsSafeAsSoonAsItIsWritten) {
  tests::HandClock clock;
  std::mutex disk;  // held: the disk hangs
  std::unique_lock hang(disk);
  RecorderOptions options{directory_};
  options.kept = [&] {
    const std::lock_guard wait(disk);
    return std::set<std::string>{};
  };
  Recorder recorder(options, clock);
  recorder.Begin("part-0001", {});
  for (std::uint64_t i = 0; i < 100; ++i) recorder.Add(NumberedProfile(i));
  clock.Advance(std::chrono::seconds(2));
  hang.unlock();
  recorder.Flush();
  EXPECT_EQ(ProfilesOf(recorder.PathOf("part-0001")), 100u);
}

TEST_F(RecorderTest, OutOfMemoryIsToldAndCostsOneSession) {
  bool has_memory = false;
  RecorderOptions options{directory_};
  options.kept = [&] {
    if (!has_memory) throw std::bad_alloc();
    return std::set<std::string>{};
  };
  Recorder recorder(options, clock_);
  recorder.Begin("part-0001", {});
  recorder.Add(NumberedProfile(0));
  recorder.Finish({});
  recorder.Flush();
  EXPECT_EQ(recorder.counters().dropped_sessions, 1u);
  EXPECT_EQ(recorder.counters().queued_points, 0u);
  EXPECT_THAT(recorder.counters().last_error, ::testing::HasSubstr("part-0001.session"));
  EXPECT_THAT(recorder.counters().last_error, ::testing::HasSubstr("out of memory"));

  has_memory = true;
  recorder.Begin("part-0002", {});
  recorder.Add(NumberedProfile(0));
  recorder.Finish({});
  recorder.Flush();
  EXPECT_EQ(ProfilesOf(recorder.PathOf("part-0002")), 1u);
  EXPECT_EQ(meta_["recording"], "complete");
  EXPECT_EQ(recorder.counters().dropped_sessions, 1u);
}

TEST_F(RecorderTest, DiscardLeavesNoFile) {
  Recorder recorder({directory_}, clock_);
  recorder.Begin("part-0001", {});
  recorder.Add(NumberedProfile(0));
  recorder.Discard();
  recorder.Flush();
  EXPECT_TRUE(fs::is_empty(directory_));
}

TEST_F(RecorderTest, AFullDiskOrAnExistingFileIsTold) {
  std::ofstream(directory_ / "part-0001.session") << "in the way";
  Recorder recorder({directory_}, clock_);
  recorder.Begin("part-0001", {});
  recorder.Add(NumberedProfile(0));
  recorder.Finish({});
  recorder.Flush();
  EXPECT_THAT(recorder.counters().last_error, ::testing::HasSubstr("part-0001.session"));
  EXPECT_EQ(recorder.counters().dropped_sessions, 1u);
}

// A disk that fills, or is given back, while no part comes: who asks must hear of it.
TEST_F(RecorderTest, TheDiskIsLookedAtAlsoWhileNothingIsRecorded) {
  tests::HandClock clock;
  const fs::path in_the_way = directory_ / "later";
  fs::create_directories(directory_);
  std::ofstream(in_the_way) << "no folder";
  Recorder recorder({in_the_way / "sessions"}, clock);
  const auto knows = [&] { return recorder.counters().knows_disk; };
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  EXPECT_FALSE(knows());  // there is none to be looked at
  fs::remove(in_the_way);
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(30);
  while (!knows() && std::chrono::steady_clock::now() < until) {
    clock.Advance(std::chrono::seconds(1));
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  EXPECT_TRUE(knows());
  EXPECT_GT(recorder.counters().free.bytes, 0u);
}

TEST_F(RecorderTest, WritesEverythingBeforeItEnds) {
  {
    Recorder recorder({directory_}, clock_);
    recorder.Begin("part-0001", {});
    for (std::uint64_t i = 0; i < 2000; ++i) recorder.Add(NumberedProfile(i));
    recorder.Finish({});
  }
  EXPECT_EQ(ProfilesOf(directory_ / "part-0001.session"), 2000u);
}

// Where nobody can tell what is still to be sent, nothing goes.
TEST_F(RecorderTest, MakesRoomButForWhatIsInHand) {
  std::ofstream(directory_ / "part-0001.session") << "sent";
  std::ofstream(directory_ / "part-0002.session") << "waits";
  RecorderOptions options{directory_};
  options.limits.most_sessions_bytes = 0;
  bool is_known = false;
  options.kept = [&]() -> hal::Result<std::set<std::string>> {
    if (!is_known) return hal::Fail(hal::ErrorKind::kDevice, "the journal cannot be read");
    return std::set<std::string>{"part-0002"};
  };
  Recorder recorder(options, clock_);
  recorder.Begin("part-0003", {});
  recorder.Finish({});
  recorder.Flush();
  EXPECT_TRUE(fs::exists(directory_ / "part-0001.session"));
  EXPECT_EQ(recorder.counters().last_error, "the journal cannot be read");
  is_known = true;
  recorder.Begin("part-0004", {});
  recorder.Finish({});
  recorder.Flush();
  EXPECT_FALSE(fs::exists(directory_ / "part-0001.session"));
  EXPECT_TRUE(fs::exists(directory_ / "part-0002.session"));
  EXPECT_EQ(recorder.counters().removed_sessions, 2u);  // part-0003, too
}

}  // namespace
}  // namespace bendloop::host
