// SPDX-License-Identifier: Apache-2.0
// Want of memory while a daemon takes up new settings: it goes on, with them or with the old ones;
// and while it serves requests or looks after its databases: that is done later.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pthread.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>

#include <atomic>
#include <fstream>
#include <sstream>
#include <thread>

#include "firmware-host/console/temporary_folder.h"
#include "firmware-host/daemon/daemon.h"
#include "firmware-host/daemon/daemon_options.h"
#include "firmware-host/daemon/requests.h"
#include "firmware-host/daemon/setter_box.h"
#include "firmware-host/daemon/upkeep.h"
#include "firmware-host/workers/want_of_memory.h"
#include "hal/clock.h"
#include "tests/support/hand_clock.h"
#include "tests/support/sample_run.h"
#include "tests/support/short_memory.h"

namespace bendloop::host {
namespace {

using namespace std::chrono_literals;
using test::ShortMemory;

constexpr const char* kThread = "daemon-test";

// Memory ends with the line that says this, until it is given back.
class Log final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  void EndMemoryAt(std::string words) {
    const std::lock_guard lock(mutex_);
    words_ = std::move(words);
  }
  void GiveBack() { shortage_.reset(); }
  bool is_short() const { return is_short_; }
  int Count(std::string_view words) {
    const std::lock_guard lock(mutex_);
    int count = 0;
    for (std::size_t at = 0; (at = text_.find(words, at)) != std::string::npos; ++at) ++count;
    return count;
  }

 protected:
  void sink_it_(const spdlog::details::log_msg& message) override {
    const std::string_view line(message.payload.data(), message.payload.size());
    if (is_short_) return;
    text_ += std::string(line) + "\n";
    if (words_.empty() || line.find(words_) == std::string_view::npos) return;
    words_.clear();
    shortage_.emplace(kThread, 1, ShortMemory::Lasts::kFromThenOn);
    is_short_ = true;
  }
  void flush_() override {}

 public:
  void HearAgain() { is_short_ = false; }

 private:
  std::string words_, text_;
  std::atomic<bool> is_short_{false};
  std::optional<ShortMemory> shortage_;
};

template <class Is>
bool Becomes(Is is) {
  for (int i = 0; i < 1000 && !is(); ++i) std::this_thread::sleep_for(5ms);
  return is();
}

TEST(ShortMemoryDaemon, OutlivesAReloadThatThereIsNoMemoryFor) {
  const auto folder = TemporaryFolder::Make();
  ASSERT_TRUE(folder);
  DaemonOptions options;
  options.config = folder->path() / "cell.toml";
  std::ofstream(options.config) << "schema = \"bendloop.cell/1\"\nname = \"test\"\npart = \""
                                << BENDLOOP_SOURCE_DIR "/config/parts/demo.toml\"\n"
                                << "state_dir = \"state\"\n"
                                << "[scanner]\nkind = \"stream\"\nport = 1\n"
                                << "[bender]\nlink = \"none\"\n";
  const auto log = std::make_shared<Log>();
  spdlog::set_default_logger(std::make_shared<spdlog::logger>("test", log));
  auto daemon = Daemon::Start(options);
  ASSERT_TRUE(daemon) << daemon.error().message;
  std::atomic<int> code{-1};
  std::thread running([&] {
    pthread_setname_np(pthread_self(), kThread);
    try {
      code = (*daemon)->Run();
    } catch (const std::bad_alloc&) {
      code = 99;
    }
  });
  constexpr const char* kBegun = " mm, settings ";  // of each beginning of a cell
  ASSERT_TRUE(Becomes([&] { return log->Count("no scanner") > 0; }));
  for (const char* words : {"SIGHUP: ", kBegun}) {
    const int begun = log->Count(kBegun);
    log->EndMemoryAt(words);
    Daemon::NoteHangUp();
    ASSERT_TRUE(Becomes([&] { return log->is_short(); })) << words;
    std::this_thread::sleep_for(100ms);
    log->GiveBack();
    log->HearAgain();
    EXPECT_TRUE(Becomes([&] { return log->Count(kBegun) > begun || code >= 0; })) << words;
    EXPECT_EQ(code, -1) << words;
  }
  Daemon::RequestStop();
  running.join();
  EXPECT_EQ(code, 0);
  spdlog::set_default_logger(std::make_shared<spdlog::logger>("none"));
}

// The PLC asks once: what there was no memory for is done at the next turn.
TEST(ShortMemoryRequests, AnAcknowledgementOfThePlcIsNotLost) {
  const auto folder = TemporaryFolder::Make();
  ASSERT_TRUE(folder);
  auto store = StateStore::Open(folder->path() / "state");
  ASSERT_TRUE(store);
  AlarmBoard alarms([] { return std::int64_t{0}; });
  config::CellConfig cell;
  const auto plan = std::make_shared<const PartPlan>();
  hal::SteadyClock clock;
  PartKeeper keeper(*store, cell, *plan, alarms);
  PartSetter parts(cell, plan, clock, keeper, alarms);
  PlcDesk plc(alarms);
  Requests requests({*store, parts, keeper, alarms, plc});
  BenderDesk::Options options;
  options.journal = store->journal();
  const auto desk = BenderDesk::Open(config::BenderConfig{}, options, clock);
  ASSERT_TRUE(desk) << desk.error().message;
  CommitJournal journal = CommitJournal::Open(store->journal()).value();
  ASSERT_TRUE(journal.NoteBreach("attempt 1", "it made active what was not sent"));
  ASSERT_FALSE((*desk)->Locked().empty());
  requests.PlcAcknowledges();
  {
    pthread_setname_np(pthread_self(), kThread);
    const ShortMemory shortage(kThread, 1, ShortMemory::Lasts::kFromThenOn);
    EXPECT_FALSE(HasMemoryFor([&] { (void)requests.Serve(**desk, false); }));
  }
  EXPECT_FALSE((*desk)->Locked().empty());
  (void)requests.Serve(**desk, false);
  EXPECT_TRUE((*desk)->Locked().empty());
}

// Whoever asks is answered once, whenever memory ends, and what was taken is not granted again.
TEST(ShortMemoryRequests, ASetterIsToldThatItMayBeDoneOrNot) {
  pthread_setname_np(pthread_self(), kThread);
  const auto folder = TemporaryFolder::Make();
  ASSERT_TRUE(folder);
  const auto requests = folder->path() / "requests";
  std::filesystem::create_directory(requests);
  std::ofstream(requests / "1.request.json")
      << R"({"schema": "bendloop.request/1", "request": "undo"})";
  int granted = 0;
  std::optional<ShortMemory> shortage;
  const auto grant = [&](const SetterRequest&) {
    ++granted;
    shortage.emplace(kThread, 1, ShortMemory::Lasts::kFromThenOn);
    return SetterAnswer{{}, std::string(100, 'x')};
  };
  const SetterBox box(folder->path());
  const auto serve = [&] { box.Serve([](const SetterRequest&) { return true; }, grant); };
  EXPECT_FALSE(HasMemoryFor(serve));
  shortage.reset();
  EXPECT_TRUE(HasMemoryFor(serve));
  EXPECT_EQ(granted, 1);
  std::stringstream answer;
  answer << std::ifstream(requests / "1.answer.json").rdbuf();
  EXPECT_THAT(answer.str(), ::testing::HasSubstr("\"exit_code\":4"));
  EXPECT_THAT(answer.str(), ::testing::HasSubstr("it may be done, or not"));
}

// Once a day is too seldom for what met want of memory in its middle.
TEST(ShortMemoryUpkeep, WhatIsTooOldGoesSoonAfterAWant) {
  pthread_setname_np(pthread_self(), kThread);
  int lacked = 0;
  for (std::int64_t number = 1;; number *= 2) {
    SCOPED_TRACE(number);
    const auto folder = TemporaryFolder::Make();
    ASSERT_TRUE(folder);
    auto store = StateStore::Open(folder->path() / "state");
    ASSERT_TRUE(store);
    auto history = History::Open(store->history());
    for (const char* time : {"2026-01-01T00:00:00.000Z", "2026-03-01T00:00:00.000Z"}) {
      RunResult run = SampleRun();
      run.time = run.session = time;
      ASSERT_TRUE(history->Add(run));
    }
    AlarmBoard alarms([] { return std::int64_t{0}; });
    config::CellConfig cell;
    cell.storage.max_age_days = 20;  // between the ages of the two, as retention/age.h counts them
    tests::HandClock clock;
    PartKeeper keeper(*store, cell, PartPlan{}, alarms);
    const StatusBoard board;
    Upkeep upkeep(cell.storage, clock, alarms, keeper, board);
    const auto desk = BenderDesk::Open(config::BenderConfig{},
                                       {.journal = ":memory:", .preload = {}, .commit = {}}, clock);
    ASSERT_TRUE(desk);
    {
      const ShortMemory shortage(kThread, number, ShortMemory::Lasts::kFromThenOn);
      HasMemoryFor([&] { upkeep.Do(**desk); });
    }
    if (ShortMemory::failed() == 0) break;
    ++lacked;
    clock.Advance(10min);
    upkeep.Do(**desk);
    ASSERT_EQ(*history->Count(), 1u);
  }
  EXPECT_GT(lacked, 5);
}

}  // namespace
}  // namespace bendloop::host
