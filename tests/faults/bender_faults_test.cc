// SPDX-License-Identifier: Apache-2.0
//
// After any fault at any call, on either side, the bender holds the old or the new program
// complete, what we reported is true and stays true, and a later start finds out the rest.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <map>
#include <optional>
#include <vector>

#include "firmware-host/commit/commit_protocol.h"
#include "tests/support/canopen_bender_under_test.h"
#include "tests/support/faulty_link.h"
#include "tests/support/memory_bender.h"
#include "tests/support/modbus_bender_under_test.h"

namespace bendloop::test {
namespace {

using host::CommitJournal;
using host::CommitOutcome;
using host::CommitProtocol;
using host::CommitReport;
using host::CommitRequest;

class BenderFaults : public testing::Test {
 protected:
  BenderFaults() : journal_(CommitJournal::Open(":memory:").value()) {}

  void Reset(const hal::RegisterMap& map) {
    bender_.emplace(map, hal::ProgramBlock{42, 3, RandomProgram(random_, 4), 0});
    journal_ = CommitJournal::Open(":memory:").value();
    request_ = {"scan", bender_->Active(), RandomProgram(random_, 4)};
    late_commit_.reset();
  }

  // The report of a run that may die under the fault.
  std::optional<CommitReport> Run(FaultyLink& link) {
    try {
      return CommitProtocol(link, journal_, clock_).Commit(request_);
    } catch (const Crash&) {
      return std::nullopt;
    }
  }

  bool HoldsBase() const { return bender_->Active() == request_.base; }
  bool HoldsNext() const {
    const hal::ProgramBlock active = bender_->Active();
    const auto attempt = journal_.Last().value();
    return attempt && active == attempt->next;
  }

  void DeliverLateCommit() {
    if (late_commit_) bender_->Deliver(*late_commit_);
    late_commit_.reset();
  }

  // Everything that must hold after a run and a new start with a link that works again.
  void CheckInvariants(const std::optional<CommitReport>& report) {
    ASSERT_TRUE(HoldsBase() || HoldsNext());
    std::optional<CommitOutcome> outcome;
    if (report && report->outcome != CommitOutcome::kUnknown) outcome = report->outcome;
    if (outcome == CommitOutcome::kCommitted) {
      ASSERT_TRUE(HoldsNext());
    }
    if (outcome && outcome != CommitOutcome::kCommitted) {
      ASSERT_TRUE(HoldsBase()) << report->reason;
      DeliverLateCommit();
      ASSERT_TRUE(HoldsBase()) << "a late commit came through after: " << report->reason;
    }
    CommitProtocol restarted(*bender_, journal_, clock_);
    const auto resumed = restarted.Resume();
    if (outcome) {
      ASSERT_FALSE(resumed) << "nothing was open";
    }
    if (resumed) {
      ASSERT_NE(resumed->outcome, CommitOutcome::kUnknown) << resumed->reason;
      ASSERT_EQ(resumed->outcome == CommitOutcome::kCommitted, HoldsNext()) << resumed->reason;
      ASSERT_EQ(resumed->active, bender_->Active());
    }
    const hal::ProgramBlock settled = bender_->Active();
    DeliverLateCommit();
    ASSERT_EQ(bender_->Active(), settled) << "a late commit came through after Resume";
    ASSERT_FALSE(journal_.Unfinished().value());
    ASSERT_EQ(journal_.SessionCommitted("scan").value(), HoldsNext());
    for (const auto& [sequence, times] : bender_->commits()) {
      ASSERT_EQ(times, 1) << "sequence " << sequence << " was committed more than once";
    }
    // And life goes on.
    const CommitReport next =
        restarted.Commit({"next scan", bender_->Active(), RandomProgram(random_, 4)});
    ASSERT_EQ(next.outcome, CommitOutcome::kCommitted) << next.reason;
    ASSERT_EQ(next.active, bender_->Active());
  }

  // Without a commit register: what is bent is the old program, the new one, or nothing; what is
  // said of it is true.
  void CheckDirectWrite(FaultyLink& link, const host::CommitOptions& options) {
    std::optional<CommitReport> report;
    try {
      report = CommitProtocol(link, journal_, clock_, options).Commit(request_);
    } catch (const Crash&) {
    }
    const auto holds_one = [this] {
      return HoldsBase() || HoldsNext() || bender_->Active().program.rows.empty();
    };
    EXPECT_TRUE(holds_one());
    if (report && report->outcome != CommitOutcome::kUnknown) {
      EXPECT_EQ(report->outcome == CommitOutcome::kCommitted, HoldsNext()) << report->reason;
      EXPECT_TRUE(report->breach.empty()) << "without a reply nothing is proven";
    }
    CommitProtocol restarted(*bender_, journal_, clock_, options);
    const auto resumed = restarted.Resume();
    if (resumed) {
      EXPECT_NE(resumed->outcome, CommitOutcome::kUnknown) << resumed->reason;
      EXPECT_EQ(resumed->outcome == CommitOutcome::kCommitted, HoldsNext()) << resumed->reason;
    }
    EXPECT_TRUE(holds_one());
    EXPECT_FALSE(journal_.Unfinished().value());
  }

  int CallsOfACleanRun(const hal::RegisterMap& map) {
    Reset(map);
    FaultyLink link(*bender_, {});
    EXPECT_EQ(Run(link)->outcome, CommitOutcome::kCommitted);
    return link.calls();
  }

  std::mt19937_64 random_{11};
  hal::ManualClock clock_;
  std::optional<MemoryBender> bender_;
  CommitJournal journal_;
  CommitRequest request_;
  std::optional<std::uint32_t> late_commit_;
};

TEST_F(BenderFaults, EveryCallFailsOrKillsUsBeforeAndAfterItsEffect) {
  for (const hal::RegisterMap& map : {PlainMap(), OddMap()}) {
    const int calls = CallsOfACleanRun(map);
    ASSERT_GT(calls, 8);
    for (int call = 0; call < calls; ++call) {
      for (const FaultWhen when : {FaultWhen::kBefore, FaultWhen::kAfter}) {
        for (const bool crash : {false, true}) {
          for (const int down_for : {0, 1, 3, 100000}) {
            SCOPED_TRACE(testing::Message()
                         << map.name << " call " << call << " after " << (when == FaultWhen::kAfter)
                         << " crash " << crash << " down for " << down_for);
            Reset(map);
            FaultyLink link(*bender_, {call, when, crash, down_for, {}});
            ASSERT_NO_FATAL_FAILURE(CheckInvariants(Run(link)));
          }
        }
      }
    }
  }
}

TEST_F(BenderFaults, BenderRebootsAtEveryCall) {
  const int calls = CallsOfACleanRun(PlainMap());
  for (int call = 0; call < calls; ++call) {
    for (const FaultWhen when : {FaultWhen::kBefore, FaultWhen::kAfter}) {
      for (const bool crash : {false, true}) {
        SCOPED_TRACE(testing::Message() << "call " << call << " crash " << crash);
        Reset(PlainMap());
        FaultyLink link(*bender_, {call, when, crash, 2, [this] { bender_->Reboot(); }});
        ASSERT_NO_FATAL_FAILURE(CheckInvariants(Run(link)));
      }
    }
  }
}

TEST_F(BenderFaults, HalfOfTheStagedRowsArrive) {
  const int calls = CallsOfACleanRun(PlainMap());
  for (int call = 0; call < calls; ++call) {
    for (const bool crash : {false, true}) {
      Reset(PlainMap());
      FaultyLink link(*bender_, {call, FaultWhen::kBefore, crash, 1, {}});
      link.tear_stage = [this](const hal::ProgramBlock& block) { bender_->StageHalf(block); };
      ASSERT_NO_FATAL_FAILURE(CheckInvariants(Run(link)));
    }
  }
}

// The nasty one: the write left us, the answer did not come, the PLC does it when it finds time.
TEST_F(BenderFaults, CommitComesLateAtAnyMoment) {
  for (int polls_until_done = 0; polls_until_done < 400; polls_until_done += 7) {
    for (const bool ever : {true, false}) {
      SCOPED_TRACE(testing::Message() << "late by " << polls_until_done << " " << ever);
      Reset(PlainMap());
      FaultyLink link(*bender_, {});
      int polls = ever ? polls_until_done : 1 << 30;
      link.before_call = [&](int) {
        if (late_commit_ && polls-- == 0) DeliverLateCommit();
      };
      link.swallow_commit = [this](std::uint32_t sequence) { late_commit_ = sequence; };
      ASSERT_NO_FATAL_FAILURE(CheckInvariants(Run(link)));
    }
  }
}

TEST_F(BenderFaults, SeededChaos) {
  constexpr int kRuns = 600;
  std::map<std::string, int> outcomes;
  for (int run = 0; run < kRuns; ++run) {
    SCOPED_TRACE(testing::Message() << "run " << run);
    std::mt19937_64 dice(static_cast<std::uint64_t>(run));
    Reset(dice() % 2 ? PlainMap() : OddMap());
    Fault fault;
    fault.at_call = static_cast<int>(dice() % 16);
    fault.when = dice() % 2 ? FaultWhen::kBefore : FaultWhen::kAfter;
    fault.crash = dice() % 3 == 0;
    fault.down_for = static_cast<int>(dice() % 4 == 0 ? 100000 : dice() % 5);
    if (dice() % 3 == 0) fault.bender_side = [this] { bender_->Reboot(); };
    if (dice() % 4 == 0) bender_->reject_code = 5;
    FaultyLink link(*bender_, fault);
    if (dice() % 3 == 0) {
      link.swallow_commit = [this](std::uint32_t sequence) { late_commit_ = sequence; };
    }
    if (dice() % 3 == 0) {
      link.tear_stage = [this](const hal::ProgramBlock& block) { bender_->StageHalf(block); };
    }
    const auto report = Run(link);
    bender_->reject_code = 0;
    ++outcomes[report ? Name(report->outcome) : "crash"];
    ASSERT_NO_FATAL_FAILURE(CheckInvariants(report));
  }
  // The dice must reach every end, or the test has gone blind.
  EXPECT_EQ(outcomes.size(), 5u);
  for (const auto& [outcome, count] : outcomes) EXPECT_GT(count, 5) << outcome;
}

// Power goes, ours, the bender's or both, before and after every step; our journal comes back from
// what was on the disk at that moment.
TEST_F(BenderFaults, PowerLossAtEveryStep) {
  namespace fs = std::filesystem;
  // In memory where possible: it is not the disk's speed that is tried here.
  const fs::path memory = "/dev/shm";
  const fs::path folder =
      (access(memory.c_str(), W_OK) == 0 ? memory : fs::path(testing::TempDir())) /
      ("bendloop-power-" + std::to_string(getpid()));
  const auto open = [&](const char* name) { return CommitJournal::Open(folder / name).value(); };
  constexpr int kSeeds = 14;
  int deaths = 0;
  int new_programs = 0;
  for (const hal::RegisterMap& map : {PlainMap(), OddMap()}) {
    const int calls = CallsOfACleanRun(map);
    for (int call = 0; call < calls; ++call) {
      for (const FaultWhen when : {FaultWhen::kBefore, FaultWhen::kAfter}) {
        for (int seed = 0; seed < kSeeds; ++seed) {
          const int whose = seed % 3;  // ours, the bender's, both
          SCOPED_TRACE(testing::Message() << map.name << " call " << call << " after "
                                          << (when == FaultWhen::kAfter) << " seed " << seed);
          random_.seed(static_cast<std::uint64_t>(seed) * 1000 + static_cast<std::uint64_t>(call));
          Reset(map);
          fs::remove_all(folder);
          fs::create_directories(folder);
          journal_ = open("live");
          FaultyLink link(*bender_, {call, when, whose != 1, seed % 4, {}});
          if (seed % 2 == 1) {
            link.tear_stage = [this](const hal::ProgramBlock& block) { bender_->StageHalf(block); };
          }
          link.before_call = [&](int now) {
            if (whose != 0 && now == call + (when == FaultWhen::kAfter)) bender_->Reboot();
          };
          const auto report = Run(link);
          if (!report) {
            ++deaths;
            for (const char* suffix : {"", "-wal"}) {
              const fs::path file = folder / (std::string("live") + suffix);
              if (fs::exists(file)) fs::copy(file, folder / (std::string("dead") + suffix));
            }
            journal_ = open("dead");
          }
          new_programs += HoldsNext();
          ASSERT_NO_FATAL_FAILURE(CheckInvariants(report));
        }
      }
    }
  }
  fs::remove_all(folder);
  EXPECT_GT(deaths, 400);
  EXPECT_GT(new_programs, 100);
}

// An operator loads another program while we stage: it stays, and nothing is committed over it.
TEST_F(BenderFaults, OperatorLoadsAnotherPartMeanwhile) {
  const int calls = CallsOfACleanRun(PlainMap());
  for (int call = 0; call < calls; ++call) {
    Reset(PlainMap());
    const hal::ProgramBlock other{77, 1, RandomProgram(random_, 2), 0};
    FaultyLink link(*bender_, {});
    link.before_call = [&](int now) {
      if (now == call) bender_->LoadActive(other);
    };
    const CommitReport report = CommitProtocol(link, journal_, clock_).Commit(request_);
    EXPECT_EQ(bender_->Active().part_number, 77u) << "call " << call;
    EXPECT_EQ(bender_->Active().program.rows.size(), 3u);
    // Loaded after the commit was done: then the commit did happen.
    EXPECT_NE(report.outcome, CommitOutcome::kUnknown);
    EXPECT_NE(report.outcome, CommitOutcome::kCommitted) << "call " << call;
  }
}

// Without a commit register staging destroys the old program; what must never happen is that a
// mixture is bent.
TEST_F(BenderFaults, PlcWithoutCommitRegisterNeverHoldsAMixture) {
  host::CommitOptions options;
  options.allow_non_atomic = true;
  for (int call = 0; call < 16; ++call) {
    for (const FaultWhen when : {FaultWhen::kBefore, FaultWhen::kAfter}) {
      for (const bool crash : {false, true}) {
        for (const int down_for : {0, 1, 100000}) {
          for (const bool tears : {false, true}) {
            SCOPED_TRACE(testing::Message() << "call " << call << " crash " << crash << " down for "
                                            << down_for << " torn " << tears);
            Reset(NoCommitMap());
            FaultyLink link(*bender_, {call, when, crash, down_for, {}});
            if (tears) {
              link.tear_stage = [this](const hal::ProgramBlock& block) {
                bender_->StageHalf(block);
              };
            }
            CheckDirectWrite(link, options);
          }
        }
      }
    }
  }
}

// The same over real connections, with the simulator's own faults.
template <class Cell>
void EveryMisbehaviourLeavesTheOldOrTheNewProgram(const hal::RegisterMap& map) {
  host::CommitOptions options;
  options.reply_timeout = std::chrono::milliseconds(1500);
  hal::SteadyClock clock;
  struct Case {
    const char* fault;
    std::vector<CommitOutcome> allowed;
  };
  const Case cases[] = {
      {"silent", {CommitOutcome::kFailed}},
      {"exception 4", {CommitOutcome::kFailed}},
      {"garbage", {CommitOutcome::kFailed}},
      {"wrong-unit", {CommitOutcome::kFailed}},
      {"late 900", {CommitOutcome::kFailed}},
      {"half-write", {CommitOutcome::kFailed}},
      {"freeze", {CommitOutcome::kRefused}},
      {"mode bending", {CommitOutcome::kRefused}},
      {"reject 7", {CommitOutcome::kRefused}},
      {"other-program", {CommitOutcome::kRefused}},
      {"lying-rows", {CommitOutcome::kFailed}},
      {"drop-after-stage", {CommitOutcome::kFailed}},
      {"drop-after-commit", {CommitOutcome::kCommitted}},
      {"ack-late 100", {CommitOutcome::kCommitted}},
      {"ack-late 60000", {CommitOutcome::kFailed}},
      {"reboot", {CommitOutcome::kRefused, CommitOutcome::kFailed, CommitOutcome::kCommitted}}};
  for (const Case& c : cases) {
    SCOPED_TRACE(c.fault);
    Cell cell(map);
    CommitJournal journal = CommitJournal::Open(":memory:").value();
    CommitProtocol protocol(cell.link(), journal, clock, options);
    std::mt19937_64 random(5);
    const auto base = cell.link().ReadActive();
    ASSERT_TRUE(base) << base.error().message;
    const CommitRequest request{"scan", *base, RandomProgram(random, 4)};
    cell.Misbehave(c.fault);
    const hal::ProgramBlock before = cell.Active();
    const CommitReport report = protocol.Commit(request);
    EXPECT_THAT(c.allowed, testing::Contains(report.outcome))
        << Name(report.outcome) << ": " << report.reason;
    EXPECT_EQ(report.reason.find('\n'), std::string::npos);
    if (report.outcome == CommitOutcome::kCommitted) {
      EXPECT_EQ(cell.Active(), report.active);
      EXPECT_EQ(cell.bender().commits_accepted(), 1u);
    } else {
      EXPECT_FALSE(report.reason.empty());
      EXPECT_EQ(cell.Active(), before);
      EXPECT_EQ(cell.bender().commits_accepted(), 0u);
    }
  }
}

TEST(BenderFaultsOverModbus, EveryMisbehaviourLeavesTheOldOrTheNewProgram) {
  EveryMisbehaviourLeavesTheOldOrTheNewProgram<ModbusBenderUnderTest>(PlainMap());
}

TEST(BenderFaultsOverCanopen, EveryMisbehaviourLeavesTheOldOrTheNewProgram) {
  EveryMisbehaviourLeavesTheOldOrTheNewProgram<CanopenBenderUnderTest>(ObjectMap(PlainMap()));
}

}  // namespace
}  // namespace bendloop::test
