// SPDX-License-Identifier: Apache-2.0
// Want of memory at each allocation in turn: nothing ends but what was at hand, it is counted, and
// the next turn is whole.
#include "tests/support/short_memory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pthread.h>

#include <atomic>
#include <utility>
#include <vector>

#include "config/load.h"
#include "firmware-host/cell/cell_loop.h"
#include "firmware-host/daemon/status_client.h"
#include "firmware-host/daemon/status_server.h"
#include "firmware-host/result/json.h"
#include "firmware-host/workers/spare_memory.h"
#include "firmware-host/workers/want_of_memory.h"
#include "tests/support/bender_maps.h"
#include "tests/support/memory_bender.h"
#include "tests/support/scripted_source.h"

namespace bendloop::host {
namespace {

using test::ShortMemory;
using tests::HandClock;
using namespace std::chrono_literals;

// In the middle of an exchange and of its reading.
constexpr int kMostAllocations = 2000;

class ShortMemoryTest : public ::testing::Test {
 protected:
  void SetUp() override {
    auto part = config::LoadPart(BENDLOOP_SOURCE_DIR "/config/parts/demo.toml");
    ASSERT_TRUE(part);
    cell_.part = *part;
    plan_ = *MakePartPlan(cell_);
  }
  std::unique_ptr<BenderDesk> Desk() {
    auto link = std::make_unique<test::MemoryBender>(test::PlainMap(),
                                                     hal::ProgramBlock{1, 7, plan_.nominal, 0});
    auto desk = BenderDesk::Open(std::move(link),
                                 {.journal = ":memory:", .preload = {}, .commit = {}}, clock_);
    EXPECT_TRUE(desk);
    return std::move(*desk);
  }

  HandClock clock_;
  config::CellConfig cell_;
  PartPlan plan_;
  StatusBoard board_;
};

TEST_F(ShortMemoryTest, TheFollowerLosesALookAndComesAgain) {
  const auto desk = Desk();
  BenderFollower follower(*desk, nullptr, board_);
  ASSERT_TRUE(follower.LookWithin(10s));
  int number = 1;
  for (; number < kMostAllocations; ++number) {
    const std::uint64_t before = board_.Get().memory_wants;
    const ShortMemory shortage("bender", number);
    std::optional<BenderReading> look;  // where one is lost, the next one answers
    for (int tries = 0; !look && tries < 1000; ++tries) look = follower.LookWithin(10ms);
    ASSERT_TRUE(look) << number;
    if (ShortMemory::failed() == 0) break;
    // SQLite, and the link, tell want of memory as errors of theirs.
    EXPECT_TRUE(board_.Get().memory_wants > before || !look->problem.empty() || look->facts);
  }
  EXPECT_GT(number, 10);
  EXPECT_LT(number, kMostAllocations);
  EXPECT_GT(board_.Get().memory_wants, 0u);
  const auto after = follower.LookWithin(10s);
  ASSERT_TRUE(after && after->facts) << after->problem;
  EXPECT_EQ(after->facts->active.sequence, 7u);
}

TEST_F(ShortMemoryTest, TheFollowerOutlivesAWantThatLasts) {
  const auto desk = Desk();
  BenderFollower follower(*desk, nullptr, board_);
  ASSERT_TRUE(follower.LookWithin(10s));
  {
    const ShortMemory shortage("bender", 1, ShortMemory::Lasts::kFromThenOn);
    const std::uint64_t before = board_.Get().memory_wants;
    while (board_.Get().memory_wants < before + 3) follower.LookNow();
  }
  const auto after = follower.LookWithin(10s);
  ASSERT_TRUE(after && after->facts);
}

// A JSON tree wants memory where it is taken down, too, and would end the process there.
TEST_F(ShortMemoryTest, TheStatusIsMadeOfWhatIsKeptAside) {
  const SpareMemory spare;
  const CellSnapshot cell = board_.Get();
  const auto page = [&] { return Dump(StatusJson(cell), 2); };
  const std::string whole = page();
  char name[16] = {};
  pthread_getname_np(pthread_self(), name, sizeof name);
  int number = 1;
  for (;; ++number) {
    const ShortMemory shortage(name, number);
    const std::string text = page();
    if (ShortMemory::failed() == 0) break;
    ASSERT_EQ(text, whole) << number;
    ASSERT_FALSE(SpareMemory::Refill()) << "it had been given";
    ASSERT_TRUE(SpareMemory::Refill());
  }
  EXPECT_GT(number, 100);
}

TEST_F(ShortMemoryTest, WhatIsKeptAsideIsGivenOnce) {
  const SpareMemory spare;
  char name[16] = {};
  pthread_getname_np(pthread_self(), name, sizeof name);
  const auto takes = [&] {
    const ShortMemory shortage(name, 1);
    return HasMemoryFor([] { std::vector<int>(1000).at(0) = 1; });
  };
  EXPECT_TRUE(takes());
  EXPECT_FALSE(takes());
  EXPECT_FALSE(SpareMemory::Refill());
  EXPECT_TRUE(takes());
}

TEST_F(ShortMemoryTest, AQuestionForTheStatusIsAnsweredOrClosed) {
  std::atomic<int> wants{0};
  auto server = StatusServer::Start(0, "",
                                    {[] { return std::string(1000, 's'); },
                                     [] { return std::string(1000, 'm'); }, [&] { ++wants; }});
  ASSERT_TRUE(server);
  char name[16] = {};
  pthread_getname_np(pthread_self(), name, sizeof name);
  // The server's thread has the name of who started it, or the library's own.
  pthread_setname_np(pthread_self(), "asker");
  const auto ask = [&] { return FetchLocal((*server)->port(), "/status"); };
  int refused = 0, closed = 0;
  for (const char* thread : {"MHD-single", static_cast<const char*>(name)}) {
    for (int number = 1; number < kMostAllocations; ++number) {
      const ShortMemory shortage(thread, number);
      const auto answer = ask();
      if (ShortMemory::failed() == 0) break;
      if (answer) {
        EXPECT_EQ(*answer, std::string(1000, 's'));  // never half of it
      } else if (answer.error().message.find("503") != std::string::npos) {
        ++refused;
      } else {
        ++closed;
      }
    }
  }
  EXPECT_GT(refused, 0);
  EXPECT_GT(closed, 0);
  EXPECT_GE(wants, refused);
  const auto after = ask();
  ASSERT_TRUE(after) << after.error().message;
  EXPECT_EQ(*after, std::string(1000, 's'));
  pthread_setname_np(pthread_self(), name);
}

// Two scans by one loop: in the first there is no memory from some allocation of its thread on,
// until its end; the second is measured.
class ShortMemoryLoopTest : public ShortMemoryTest {
 protected:
  void SetUp() override {
    ShortMemoryTest::SetUp();
    profiles_ = tests::SparseScan({plan_.pipe_radius_mm, plan_.nominal, {}}, 3, 40);
  }
  struct Ran {
    std::vector<std::string> parts, failed;
    std::string why;
    std::string last;  // scan that began
    std::uint64_t wants = 0;
    std::int64_t lacked = 0;  // allocations
  };
  Ran Run(const char* thread, std::int64_t number, ShortMemory::Lasts lasts) {
    Ran ran;
    StatusBoard board;
    auto steps = tests::CleanScan(profiles_.size());
    const auto second = steps;
    steps.push_back({tests::ScriptedSource::Kind::kPause});
    steps.insert(steps.end(), second.begin(), second.end());
    tests::ScriptedSource source(profiles_, std::move(steps), clock_);
    std::atomic<bool> may_go_on{false};
    source.silence_over = [&] { return may_go_on.load(); };
    const auto desk = BenderDesk::Open(
        cell_.bender, {.journal = ":memory:", .preload = {}, .commit = {}}, clock_);
    std::optional<ShortMemory> shortage;
    int scans = 0;
    CellPorts ports;
    ports.clock = &clock_;
    ports.desk = desk->get();
    ports.board = &board;
    ports.identify = [&] {
      return ScanIdentity{"part-" + std::to_string(++scans), "2026-01-01T00:00:00Z", {}};
    };
    ports.part_done = [&](const PartOutcome& part) { ran.parts.push_back(part.result.session); };
    ports.scan_failed = [&](const FailedScan& scan) {
      ran.failed.push_back(scan.identity.session);
      ran.why = scan.error.message;
    };
    // The loop's own sign of life comes at each turn, in its thread, and may need no memory here:
    // when the first scan is over memory is back, and the second one comes.
    ports.alive = [&] {
      bool is_over = false;
      board.Update([&](const CellSnapshot& now) {
        is_over =
            now.phase == CellPhase::kWaiting && now.parts + now.failed_scans + now.memory_wants > 0;
      });
      if (!is_over) return;
      shortage.reset();
      may_go_on = true;
    };
    CellLoopOptions options;
    options.scan.starts_by_event = true;
    CellLoop loop(plan_, std::move(ports), options);
    ProfileRing ring(4096, source.Info().max_points);
    Acquisition acquisition(source, source.Info(), ring, clock_, {});
    EXPECT_TRUE(acquisition.Start());
    char name[16] = {};
    pthread_getname_np(pthread_self(), name, sizeof name);
    shortage.emplace(*thread == 0 ? name : thread, number, lasts);
    loop.Run(acquisition, ring, source.Info());
    acquisition.Stop();
    ran.wants = board.Get().memory_wants;
    ran.last = "part-" + std::to_string(scans);
    ran.lacked = ShortMemory::failed();
    return ran;
  }
  std::vector<hal::LaserProfile> profiles_;
};

// Sparse numbers: a whole scan has too many to try each.
TEST_F(ShortMemoryLoopTest, ACellLoopGoesOnAndMeasuresTheNextPart) {
  int cut = 0;
  for (const char* thread : {"", "beside-loop"}) {
    for (const auto lasts : {ShortMemory::Lasts::kOnce, ShortMemory::Lasts::kFromThenOn}) {
      for (std::int64_t number = 1; number < 10'000'000; number *= 40) {
        SCOPED_TRACE(std::string(thread) + " " + std::to_string(number));
        const Ran ran = Run(thread, number, lasts);
        ASSERT_FALSE(ran.parts.empty());
        EXPECT_EQ(ran.parts.back(), ran.last);
        if (ran.lacked == 0) break;
        if (ran.parts.size() == 2) continue;  // SQLite's, or the log's
        EXPECT_GT(ran.wants, 0u);
        ++cut;
        if (ran.failed.empty()) continue;  // there was no memory to tell it, either: the count does
        EXPECT_THAT(ran.failed, ::testing::ElementsAre("part-1"));
        EXPECT_THAT(ran.why, ::testing::HasSubstr("out of memory"));
      }
    }
  }
  EXPECT_GT(cut, 4);
}

}  // namespace
}  // namespace bendloop::host
