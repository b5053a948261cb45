// SPDX-License-Identifier: Apache-2.0
// What the recorder leaves out for want of memory at whoever gives it profiles: the mark in the
// recording names this cause, the disk's, or both, as it was.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pthread.h>

#include <array>

#include "drivers/session/session_reader.h"
#include "firmware-host/recorder/recorder.h"
#include "tests/support/hand_clock.h"
#include "tests/support/recorded_profiles.h"
#include "tests/support/short_memory.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;
using test::NumberedProfile;
using test::ShortMemory;

class ShortMemoryRecorderTest : public ::testing::Test {
 protected:
  ShortMemoryRecorderTest() {
    pthread_getname_np(pthread_self(), own_name_.data(), own_name_.size());
  }

  // One more than may wait is given where the disk is meant to be slow.
  std::string GapAfter(bool is_slow, bool is_short) {
    RecorderOptions options{directory_};
    options.queue_points = 15;
    Recorder recorder(options, clock_);
    recorder.Begin(kName, {});
    const hal::LaserProfile small = NumberedProfile(1), large = NumberedProfile(2, 20),
                            last = NumberedProfile(3);
    recorder.Flush();
    if (is_short) {
      {
        const ShortMemory shortage(own_name_.data(), 1, ShortMemory::Lasts::kFromThenOn);
        recorder.Add(small);
      }
      EXPECT_GT(ShortMemory::failed(), 0);
      EXPECT_THAT(recorder.counters().last_error, ::testing::HasSubstr("out of memory"));
    }
    if (is_slow) {
      recorder.Add(large);
      EXPECT_THAT(recorder.counters().last_error, ::testing::HasSubstr("too slow"));
    }
    recorder.Add(last);
    recorder.Finish({});
    recorder.Flush();
    return OnlyEvent(recorder.PathOf(kName));
  }
  std::string OnlyEvent(const fs::path& path) {
    auto reader = drivers::SessionReader::Open(path.string());
    EXPECT_TRUE(reader) << reader.error().message;
    if (!reader) return {};
    hal::ScanEvent event;
    std::string detail;
    for (int events = 0; reader->NextEvent(event).value_or(false); ++events) {
      EXPECT_EQ(events, 0);
      detail = event.detail();
    }
    EXPECT_EQ(reader->meta().at("recording"), "incomplete");
    fs::remove(path);
    return detail;
  }

  static constexpr const char* kName = "part-0001";
  tests::HandClock clock_;
  test::RecordingFolder folder_;
  const fs::path& directory_ = folder_.path();
  std::array<char, 16> own_name_{};  // of the thread that gives
};

TEST_F(ShortMemoryRecorderTest, WhatThereIsNoMemoryToTellDoesNotEndTheScan) {
  RecorderOptions options{directory_};
  options.queue_points = 15;
  Recorder recorder(options, clock_);
  recorder.Begin(kName, {});
  const hal::LaserProfile large = NumberedProfile(1, 20);
  {
    const ShortMemory shortage(own_name_.data(), 1, ShortMemory::Lasts::kFromThenOn);
    EXPECT_NO_THROW(recorder.Add(large));
  }
  EXPECT_GT(ShortMemory::failed(), 0);
  EXPECT_EQ(recorder.counters().last_error, "out of memory");
  recorder.Finish({});
  recorder.Flush();
  EXPECT_EQ(OnlyEvent(recorder.PathOf(kName)),
            "lost 1 profiles: the disk was too slow for the recorder");
}

TEST_F(ShortMemoryRecorderTest, AGapNamesItsCauses) {
  EXPECT_EQ(GapAfter(true, false), "lost 1 profiles: the disk was too slow for the recorder");
  EXPECT_EQ(GapAfter(false, true), "lost 1 profiles: there was no memory for the recorder");
  EXPECT_EQ(GapAfter(true, true),
            "lost 2 profiles: the disk was too slow and there was no memory for the recorder");
}

}  // namespace
}  // namespace bendloop::host
