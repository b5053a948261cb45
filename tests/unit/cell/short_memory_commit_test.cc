// SPDX-License-Identifier: Apache-2.0
// Want of memory at each allocation of a commit in turn, once and from then on: the bender holds
// the old program or the new one, whole; no commit is written twice; and the next look settles what
// was left open, as the journal tells.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pthread.h>

#include <list>

#include "firmware-host/cell/bender_desk.h"
#include "tests/support/hand_clock.h"
#include "tests/support/memory_bender.h"
#include "tests/support/short_memory.h"

namespace bendloop::host {
namespace {

using test::ShortMemory;

// Each in turn takes ten seconds; a prime, so that no period of the code's own is always missed.
constexpr std::int64_t kStride = 17;

// A bender in the same thread, whose link lacks memory, too.
class ShortMemoryCommitTest : public ::testing::Test {
 protected:
  struct Ended {
    std::optional<CommitReport> report;  // none: thrown
    std::int64_t lacked = 0;
  };

  void Begin() {
    std::mt19937_64 random(5);
    old_ = {42, 3, test::RandomProgram(random, 4), 0};
    request_ = {"scan-1", {}, test::RandomProgram(random, 4)};
    auto link = std::make_unique<test::MemoryBender>(test::PlainMap(), old_);
    bender_ = link.get();
    old_ = request_.base = bender_->Active();
    auto desk = BenderDesk::Open(std::move(link),
                                 {.journal = ":memory:", .preload = {}, .commit = {}}, clock_);
    ASSERT_TRUE(desk);
    desk_ = std::move(*desk);
    ASSERT_TRUE(desk_->Look().facts);
  }

  Ended CommitShortOf(std::int64_t number, ShortMemory::Lasts lasts) {
    char name[16] = {};
    pthread_getname_np(pthread_self(), name, sizeof name);
    Ended ended;
    const CommitRequest request = request_;
    {
      const ShortMemory shortage(name, number, lasts);
      try {
        ended.report = desk_->Commit(request);
      } catch (const std::bad_alloc&) {
      }
    }
    ended.lacked = ShortMemory::failed();
    return ended;
  }

  bool IsNew(const hal::ProgramBlock& active) const { return active.sequence != old_.sequence; }

  // Nothing half sent, and nothing twice.
  void ExpectWhole() {
    const hal::ProgramBlock active = bender_->Active();
    if (active.sequence == old_.sequence) {
      EXPECT_EQ(active, old_);
    } else {
      ASSERT_EQ(active.program.rows.size(), request_.program.rows.size());
      for (std::size_t i = 0; i < active.program.rows.size(); ++i) {
        EXPECT_NEAR(active.program.rows[i].angle_deg, request_.program.rows[i].angle_deg, 0.00051);
      }
    }
    for (const auto& [sequence, times] : bender_->commits()) EXPECT_EQ(times, 1) << sequence;
  }

  // What stands open is settled by the next look with memory, and told once, as it is.
  void ExpectSettled(const Ended& ended) {
    ASSERT_TRUE(desk_->Look().facts);
    ExpectWhole();
    EXPECT_FALSE(desk_->OpenCommit());
    std::list<SettledCommit> settled;
    desk_->TakeSettled(settled);
    const bool has_end = ended.report && ended.report->outcome != CommitOutcome::kUnknown;
    if (has_end) {
      EXPECT_TRUE(settled.empty());
    }
    EXPECT_LE(settled.size(), 1u);
    if (!IsNew(bender_->Active())) {
      for (const SettledCommit& end : settled) {
        EXPECT_NE(end.report.outcome, CommitOutcome::kCommitted);
      }
    }
    if (!has_end && IsNew(bender_->Active())) {
      ASSERT_EQ(settled.size(), 1u);
      EXPECT_EQ(settled.front().session, request_.session);
      EXPECT_EQ(settled.front().report.outcome, CommitOutcome::kCommitted);
    }
    const bool is_new = IsNew(bender_->Active());
    const bool is_told = ended.report && ended.report->outcome == CommitOutcome::kCommitted;
    EXPECT_TRUE(is_new || !is_told);
    EXPECT_EQ(desk_->Locked(), "") << "our own want of memory is no breach of the bender's";
    // Made again, as the cell does with what has not reached the bender: once, and whole.
    const CommitReport again = desk_->Commit(request_);
    EXPECT_EQ(again.outcome, is_new ? CommitOutcome::kRefused : CommitOutcome::kCommitted)
        << again.reason;
    ExpectWhole();
    EXPECT_FALSE(desk_->OpenCommit());
    EXPECT_TRUE(desk_->SessionCommitted("scan-1"));
  }

  tests::HandClock clock_;
  hal::ProgramBlock old_;
  CommitRequest request_;
  std::unique_ptr<BenderDesk> desk_;
  test::MemoryBender* bender_ = nullptr;
};

TEST_F(ShortMemoryCommitTest, ACommitIsWholeAndOnceWhereverMemoryFails) {
  for (const auto lasts : {ShortMemory::Lasts::kOnce, ShortMemory::Lasts::kFromThenOn}) {
    int before = 0, thrown = 0;
    for (std::int64_t number = 1;; number += kStride) {
      SCOPED_TRACE(std::to_string(number) +
                   (lasts == ShortMemory::Lasts::kOnce ? " once" : " from then on"));
      Begin();
      const Ended ended = CommitShortOf(number, lasts);
      if (ended.lacked == 0) break;
      thrown += !ended.report;
      before += !IsNew(bender_->Active());
      ExpectWhole();
      ExpectSettled(ended);
      if (HasFailure()) return;
    }
    EXPECT_GT(thrown, 0);
    EXPECT_GT(before, 0);
  }
}

// The bender has taken the program, and the journal does not take that.
TEST_F(ShortMemoryCommitTest, AnEndThatTheJournalHasNotTakenIsToldOnce) {
  // From the commit's write on, more or less.
  constexpr std::int64_t kLast = 300;
  std::int64_t allocations = 1;
  for (;; allocations *= 2) {
    Begin();
    if (CommitShortOf(allocations, ShortMemory::Lasts::kOnce).lacked == 0) break;
  }
  for (std::int64_t step = allocations / 4; step > 0; step /= 2) {
    Begin();
    if (CommitShortOf(allocations - step, ShortMemory::Lasts::kOnce).lacked == 0) {
      allocations -= step;
    }
  }
  int told_and_open = 0;
  for (std::int64_t number = allocations - kLast; number < allocations; number += 2) {
    SCOPED_TRACE(number);
    Begin();
    const Ended ended = CommitShortOf(number, ShortMemory::Lasts::kOnce);
    told_and_open += ended.report && ended.report->outcome == CommitOutcome::kCommitted &&
                     desk_->OpenCommit().has_value();
    ExpectSettled(ended);
    if (HasFailure()) return;
  }
  EXPECT_GT(told_and_open, 0);
}

// Nor has the look that finds out how a cut commit ended the memory to tell it.
TEST_F(ShortMemoryCommitTest, AnEndThatALookLacksMemoryToTellIsToldByTheNext) {
  std::int64_t behind_write = 1;  // thrown, and the bender has it
  for (;; behind_write += 5) {
    Begin();
    const Ended ended = CommitShortOf(behind_write, ShortMemory::Lasts::kOnce);
    ASSERT_GT(ended.lacked, 0);
    if (!ended.report && IsNew(bender_->Active())) break;
  }
  for (const auto lasts : {ShortMemory::Lasts::kOnce, ShortMemory::Lasts::kFromThenOn}) {
    int cut = 0;
    for (std::int64_t number = 1;; number += kStride) {
      SCOPED_TRACE(number);
      Begin();
      const Ended ended = CommitShortOf(behind_write, ShortMemory::Lasts::kOnce);
      ASSERT_FALSE(ended.report);
      std::int64_t lacked = 0;
      {
        char name[16] = {};
        pthread_getname_np(pthread_self(), name, sizeof name);
        const ShortMemory shortage(name, number, lasts);
        try {
          (void)desk_->Look();
        } catch (const std::bad_alloc&) {
        }
        lacked = ShortMemory::failed();
      }
      ExpectSettled(ended);
      if (HasFailure()) return;
      if (lacked == 0) break;
      ++cut;
    }
    EXPECT_GT(cut, 5);
  }
}

}  // namespace
}  // namespace bendloop::host
