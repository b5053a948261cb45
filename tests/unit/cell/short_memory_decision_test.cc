// SPDX-License-Identifier: Apache-2.0
// Want of memory at each allocation of a decision in turn: what the bender has taken is told, and
// what the part taught its lot is kept.
#include <gtest/gtest.h>
#include <pthread.h>

#include "bent_tube.h"
#include "tests/support/short_memory.h"

namespace bendloop::host {
namespace {

using test::ShortMemory;

// A prime, so that no period of the code's own is always missed.
constexpr std::int64_t kDecisionStride = 37;

struct Decided {
  std::optional<PartOutcome> outcome;  // none: thrown
  std::int64_t lacked = 0;
};

Decided DecideShortOf(test::BentTube& cell, std::int64_t number) {
  char name[16] = {};
  pthread_getname_np(pthread_self(), name, sizeof name);
  Decided decided;
  const ShortMemory shortage(name, number);
  try {
    decided.outcome = DecidePart(*cell.plan, cell.part, *cell.desk);
  } catch (const std::bad_alloc&) {
  }
  decided.lacked = ShortMemory::failed();
  return decided;
}

TEST(ShortMemoryDecision, WhatReachedTheBenderIsToldWithWhatItTaught) {
  int waited = 0, corrected = 0;
  for (std::int64_t number = 1;; number += kDecisionStride) {
    SCOPED_TRACE(number);
    test::BentTube cell;
    const Decided decided = DecideShortOf(cell, number);
    if (decided.lacked == 0) {
      ASSERT_TRUE(decided.outcome);
      EXPECT_EQ(decided.outcome->end, PartEnd::kCorrected);
      break;
    }
    const bool reached = cell.is_corrected();
    ASSERT_TRUE(decided.outcome || !reached) << "nobody would know what it taught";
    cell.Look();
    EXPECT_EQ(cell.is_corrected(), reached);
    const auto settled = cell.Settled();
    if (!reached) continue;
    EXPECT_TRUE(decided.outcome->next);
    corrected += decided.outcome->end == PartEnd::kCorrected;
    if (decided.outcome->end == PartEnd::kCorrected) {
      EXPECT_TRUE(settled.empty());
      continue;
    }
    ++waited;
    EXPECT_EQ(decided.outcome->end, PartEnd::kWaiting) << Name(decided.outcome->end);
    ASSERT_EQ(settled.size(), 1u);
    EXPECT_EQ(settled.front().report.outcome, CommitOutcome::kCommitted);
    if (HasFailure()) return;
  }
  EXPECT_GT(waited, 0);
  EXPECT_GT(corrected, 0);
}

}  // namespace
}  // namespace bendloop::host
