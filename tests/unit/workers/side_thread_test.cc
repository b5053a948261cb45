// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/workers/side_thread.h"

#include <gtest/gtest.h>

#include <atomic>
#include <new>
#include <thread>

#include "firmware-host/workers/want_of_memory.h"

namespace bendloop::host {
namespace {

constexpr std::chrono::milliseconds kPeriod{1};

TEST(SideThread, DoesOneThingAfterAnotherInOneThreadOfItsOwn) {
  SideThread beside;
  std::thread::id first;
  for (int i = 0; i < 100; ++i) {
    std::thread::id where;
    beside.Do([&] { where = std::this_thread::get_id(); }, kPeriod, [] {});
    if (i == 0) first = where;
    EXPECT_EQ(where, first);
    EXPECT_NE(where, std::this_thread::get_id());
  }
}

TEST(SideThread, ItsOwnerGoesOnMeanwhile) {
  SideThread beside;
  std::atomic<int> turns{0};
  beside.Do(
      [&] {
        while (turns < 3) std::this_thread::yield();
      },
      kPeriod, [&] { ++turns; });
  EXPECT_GE(turns, 3);
}

TEST(SideThread, WhatIsThrownComesToItsOwnerWhenTheWorkHasEnded) {
  SideThread beside;
  EXPECT_THROW(beside.Do([] { throw std::bad_alloc(); }, kPeriod, [] {}), std::bad_alloc);
  std::atomic<bool> thrown{false};
  bool ended = false;
  const auto work = [&] {
    while (!thrown) std::this_thread::yield();
    ended = true;
  };
  const auto meanwhile = [&] {
    thrown = true;
    throw std::bad_alloc();
  };
  EXPECT_THROW(beside.Do(work, kPeriod, meanwhile), std::bad_alloc);
  EXPECT_TRUE(ended);
  int done = 0;
  beside.Do([&] { ++done; }, kPeriod, [] {});
  EXPECT_EQ(done, 1);
}

TEST(WantOfMemory, IsToldFromOtherErrors) {
  EXPECT_TRUE(HasMemoryFor([] {}));
  EXPECT_FALSE(HasMemoryFor([] { throw std::bad_alloc(); }));
  EXPECT_FALSE(HasMemoryFor([] {
    throw std::system_error(std::make_error_code(std::errc::resource_unavailable_try_again));
  }));
  EXPECT_THROW(HasMemoryFor([] {
                 throw std::system_error(std::make_error_code(std::errc::permission_denied));
               }),
               std::system_error);
}

}  // namespace
}  // namespace bendloop::host
