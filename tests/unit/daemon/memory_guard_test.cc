// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/memory_guard.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <future>

namespace bendloop::host {
namespace {

TEST(MemoryGuard, WantOfMemoryInAHelperIsAnErrorWithItsName) {
  bool has_memory = false;
  const auto helper = [&] {
    return std::async(std::launch::async,
                      [&] {
                        return OrOutOfMemory("report.html: the report", [&]() -> hal::Result<void> {
                          if (!has_memory) throw std::bad_alloc();
                          return {};
                        });
                      })
        .get();
  };
  const auto starved = helper();
  ASSERT_FALSE(starved);
  EXPECT_THAT(starved.error().message, ::testing::StartsWith("report.html: the report: out of"));
  has_memory = true;
  EXPECT_TRUE(helper());
}

TEST(MemoryGuard, OtherErrorsPassAsTheyAre) {
  const auto failed =
      OrOutOfMemory("the report", [] { return hal::Fail(hal::ErrorKind::kDevice, "no space"); });
  ASSERT_FALSE(failed);
  EXPECT_EQ(failed.error().message, "no space");
}

}  // namespace
}  // namespace bendloop::host
