// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/trouble_log.h"

#include <gtest/gtest.h>

#include <vector>

namespace bendloop::host {
namespace {

using namespace std::chrono_literals;

TEST(TroubleLog, SaysATroubleThatLastsADayAFewTimes) {
  TroubleLog log;
  std::vector<std::string> said;
  std::chrono::nanoseconds now = 5s;
  // Four looks a second.
  for (; now <= 5s + 24h; now += 250ms) {
    const std::string line = log.Met("no answer", now);
    if (!line.empty()) said.push_back(line);
  }
  // After 1, 2, 4, ... minutes, each from the one before, and then every eight hours.
  ASSERT_EQ(said.size(), 11u);
  EXPECT_EQ(said[0], "no answer");
  EXPECT_EQ(said[1], "no answer, for 60 s (241 times)");
  EXPECT_EQ(said[2], "no answer, for 180 s (721 times)");
  EXPECT_EQ(log.Over(now), " after 86400 s (345601 times)");
  EXPECT_EQ(log.Over(now), "");
  // The next one is told at once.
  EXPECT_EQ(log.Met("no answer", now + 1s), "no answer");
}

TEST(TroubleLog, SaysAnotherReasonAndNotEachTimeThatTwoTakeTurns) {
  TroubleLog log;
  EXPECT_EQ(log.Met("refused", 0s), "refused");
  EXPECT_EQ(log.Met("silent", 1s), "");
  EXPECT_EQ(log.Met("refused", 2s), "");
  EXPECT_EQ(log.Met("silent", 10s), "silent");
  EXPECT_EQ(log.Met("silent", 30s), "");
  EXPECT_EQ(log.Met("refused", 31s), "refused");
  EXPECT_EQ(log.Over(32s), " after 32 s (6 times)");
}

}  // namespace
}  // namespace bendloop::host
