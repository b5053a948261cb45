// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/retention/retention.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <random>

#include "firmware-host/retention/age.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr std::int64_t kDayMs = 86'400'000;

class Retention : public ::testing::Test {
 protected:
  Retention() {
    std::string name = (fs::temp_directory_path() / "retention-XXXXXX").string();
    directory_ = mkdtemp(name.data());
    places_ = {directory_ / "sessions", directory_ / "results"};
    fs::create_directories(places_.sessions);
    fs::create_directories(places_.results);
    world_ = SystemRetentionWorld();
    world_.free_bytes = [this](const fs::path&) { return Free(); };
    limits_.most_sessions_bytes = UINT64_MAX;
  }
  ~Retention() override { fs::remove_all(directory_); }

  static std::string Name(int number) {
    char name[32];
    std::snprintf(name, sizeof name, "part-%04d", number);
    return name;
  }
  static fs::path Put(const fs::path& path, std::size_t bytes, double age_days) {
    std::ofstream(path) << std::string(bytes, 'x');
    const auto age = std::chrono::duration_cast<fs::file_time_type::duration>(
        std::chrono::duration<double>(age_days * 86400));
    fs::last_write_time(path, fs::file_time_type::clock::now() - age);
    return path;
  }
  fs::path Session(int number, std::size_t bytes = 1000, double age_days = 0) const {
    return Put(places_.sessions / (Name(number) + ".session"), bytes, age_days);
  }
  fs::path Result(int number, std::size_t bytes = 100, double age_days = 0) const {
    return Put(places_.results / (Name(number) + ".json"), bytes, age_days);
  }
  void Pin(int number) const { Put(places_.sessions / (Name(number) + ".session.keep"), 0, 0); }
  std::uint64_t Used() const {
    std::uint64_t used = others_bytes_;
    for (const auto& entry : fs::recursive_directory_iterator(directory_)) {
      if (entry.is_regular_file()) used += entry.file_size();
    }
    return used;
  }
  std::uint64_t Free() const { return disk_bytes_ - std::min(disk_bytes_, Used()); }
  Removed Keep(const std::set<std::string>& in_hand = {}) {
    return KeepLimits(places_, limits_, in_hand, world_).value();
  }

  fs::path directory_;
  RetentionPlaces places_;
  RetentionLimits limits_;
  RetentionWorld world_;
  std::uint64_t disk_bytes_ = 1'000'000;
  std::uint64_t others_bytes_ = 0;
};

TEST_F(Retention, TheOldestUnpinnedSessionsGoBeyondTheBudget) {
  const fs::path oldest = Session(1);
  const fs::path pinned = Session(2);
  Pin(2);
  const fs::path old = Session(3);
  const fs::path side = Put(places_.sessions / "part-0003.session-wal", 500, 0);
  const fs::path recent = Session(4);
  const fs::path waits = Session(5);
  const fs::path other = Put(places_.sessions / "notes.txt", 100000, 90);
  limits_.most_sessions_bytes = 3000;
  EXPECT_THAT(Keep({"part-0005"}).sessions, ElementsAre(oldest, old));
  EXPECT_FALSE(fs::exists(side));
  for (const auto& path : {pinned, recent, waits, other}) EXPECT_TRUE(fs::exists(path)) << path;
}

// Old is what has the smaller number: a clock that was set back must not make the newest the
// oldest.
TEST_F(Retention, AClockThatWasSetBackDoesNotTurnTheOrder) {
  const fs::path before = Session(1, 1000, 0);
  Session(2, 1000, 365);  // written after the clock was set back by a year
  const fs::path copy = Put(places_.sessions / "copied.session", 1000, 1);
  limits_.most_sessions_bytes = 1000;
  EXPECT_THAT(Keep().sessions, ElementsAre(copy, before));
}

TEST_F(Retention, NothingGoesWhileThereIsRoomOrNoFolder) {
  Session(1);
  limits_.most_sessions_bytes = 1000;
  EXPECT_THAT(Keep().sessions, IsEmpty());
  places_ = {directory_ / "missing", directory_ / "missing too"};
  limits_ = {0, UINT64_MAX, 1};
  EXPECT_THAT(Keep().sessions, IsEmpty());
}

TEST_F(Retention, WhatIsTooOldGoesResultsToo) {
  limits_.most_days = 30;
  const fs::path session = Session(1, 1000, 44);
  const fs::path result = Result(1, 100, 44);
  Session(2, 1000, 38);
  Pin(2);
  Result(2, 100, 38);
  const fs::path young = Session(3, 1000, 29);
  Result(3, 100, 29);
  for (int step = 4; step < 7; ++step) {  // a part a week, so that no step between them is cut
    Session(step, 1000, 29 - 7 * (step - 3));
    Result(step, 100, 29 - 7 * (step - 3));
  }
  const Removed removed = Keep();
  EXPECT_THAT(removed.sessions, ElementsAre(session));
  EXPECT_THAT(removed.results, ElementsAre(result));
}

TEST_F(Retention, AClockThatJumpsAYearMakesNothingAYearOlder) {
  limits_.most_days = 90;
  for (int i = 1; i <= 20; ++i) Result(i, 100, 20 - i);
  world_.now_ms += 365 * kDayMs;
  EXPECT_THAT(Keep().results, IsEmpty());
  Result(21, 100, -365);  // and a part of the year to come
  EXPECT_THAT(Keep().results, IsEmpty());
  world_.now_ms -= 2 * 365 * kDayMs;
  EXPECT_THAT(Keep().results, IsEmpty());
}

TEST_F(Retention, AFullDiskIsFreedOfTheOldestAndTheNewestStay) {
  for (int i = 1; i <= 30; ++i) {
    Session(i);
    Result(i);
  }
  limits_.least_free_bytes = 10'000;
  disk_bytes_ = Used() + 5'000;
  const Removed removed = Keep();
  EXPECT_EQ(removed.sessions.size(), 5u);
  EXPECT_EQ(removed.sessions.front().filename(), "part-0001.session");
  EXPECT_THAT(removed.results, IsEmpty());
  // Somebody else fills it: what would not help for long stays.
  others_bytes_ = disk_bytes_;
  EXPECT_EQ(Keep().sessions.size(), 30u - 5u - kNewestSessions);
  EXPECT_THAT(Keep().sessions, IsEmpty());
}

// Whatever happens in which order: the pinned and those in hand are there to the end, and so is
// everything while the limits hold.
TEST_F(Retention, NeverRemovesThePinnedNorWhatIsInHand) {
  for (unsigned seed = 0; seed < 60; ++seed) {
    std::mt19937 random(seed);
    const auto roll = [&](unsigned sides) { return random() % sides; };
    std::map<int, bool> pinned;
    std::set<std::string> in_hand;
    int last = 0;
    for (int step = 0; step < 60; ++step) {
      switch (roll(7)) {
        case 0:
        case 1:
        case 2:
          ++last;
          Session(last, roll(3000), static_cast<double>(roll(900)) - 450);
          Result(last, roll(300), static_cast<double>(roll(900)) - 450);
          if (roll(3) == 0) in_hand.insert(Name(last));
          break;
        case 3:
          if (last == 0) break;
          if (const int at = 1 + static_cast<int>(roll(static_cast<unsigned>(last)));
              fs::exists(places_.sessions / (Name(at) + ".session"))) {
            Pin(at);
            pinned[at] = fs::exists(places_.results / (Name(at) + ".json"));
          }
          break;
        case 4:
          if (!in_hand.empty() && roll(2) == 0) in_hand.erase(in_hand.begin());
          break;
        case 5:
          world_.now_ms += (static_cast<std::int64_t>(roll(800)) - 400) * kDayMs;
          others_bytes_ = roll(2) * disk_bytes_;
          break;
        default:
          limits_ = {roll(4) == 0 ? 0 : roll(40'000), roll(2) * roll(2'000'000),
                     static_cast<double>(roll(3) * roll(100))};
          Keep(in_hand);
      }
      for (const auto& [number, had_result] : pinned) {
        ASSERT_TRUE(fs::exists(places_.sessions / (Name(number) + ".session"))) << seed;
        ASSERT_TRUE(!had_result || fs::exists(places_.results / (Name(number) + ".json"))) << seed;
      }
      for (const std::string& name : in_hand) {
        ASSERT_TRUE(fs::exists(places_.sessions / (name + ".session"))) << seed;
        ASSERT_TRUE(fs::exists(places_.results / (name + ".json"))) << seed;
      }
    }
    fs::remove_all(places_.sessions);
    fs::remove_all(places_.results);
    fs::create_directories(places_.sessions);
    fs::create_directories(places_.results);
  }
}

TEST(Age, CountsWhatLiesBetweenNeighbours) {
  Age age(100 * kDayMs);
  EXPECT_DOUBLE_EQ(age.DaysOf(99 * kDayMs), 1);
  EXPECT_DOUBLE_EQ(age.DaysOf(95 * kDayMs), 5);
  EXPECT_DOUBLE_EQ(age.DaysOf(5000 * kDayMs), 5);  // made by a clock that went wrong
  EXPECT_DOUBLE_EQ(age.DaysOf(90 * kDayMs), 5 + Age::kMostStepDays);
}

}  // namespace
}  // namespace bendloop::host
