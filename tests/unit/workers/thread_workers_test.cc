// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/workers/thread_workers.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <new>
#include <system_error>
#include <utility>

namespace bendloop::host {
namespace {

TEST(ThreadWorkers, DoEveryRoundOnce) {
  for (const std::size_t threads : {0U, 1U, 2U, 3U, 8U}) {
    ThreadWorkers workers(threads);
    // Many short loops: who comes late to one must not disturb the next.
    for (std::size_t rounds = 0; rounds < 300; ++rounds) {
      std::vector<int> done(rounds, 0);
      workers.For(rounds, [&](std::size_t round) { ++done[round]; });
      ASSERT_EQ(std::count(done.begin(), done.end(), 1), static_cast<std::ptrdiff_t>(rounds));
    }
  }
}

TEST(ThreadWorkers, ResultsOfRoundsAreSeenAfterTheLoop) {
  ThreadWorkers workers(3);
  std::vector<double> sums(64);
  for (int loop = 0; loop < 50; ++loop) {
    workers.For(sums.size(), [&](std::size_t round) {
      double sum = 0;
      for (int i = 1; i < 500; ++i) sum += std::sin(static_cast<double>(round) * i + loop);
      sums[round] = sum;
    });
    std::vector<double> expected(sums.size());
    pipeline::ParallelFor(nullptr, expected.size(), [&](std::size_t round) {
      for (int i = 1; i < 500; ++i) {
        expected[round] += std::sin(static_cast<double>(round) * i + loop);
      }
    });
    ASSERT_EQ(sums, expected);
  }
}

TEST(ThreadWorkers, ALoopInARoundRunsThere) {
  ThreadWorkers workers(3);
  std::vector<std::vector<int>> done(40, std::vector<int>(7, 0));
  workers.For(done.size(), [&](std::size_t outer) {
    const auto thread = std::this_thread::get_id();
    workers.For(done[outer].size(), [&](std::size_t inner) {
      done[outer][inner] += thread == std::this_thread::get_id() ? 1 : 100;
    });
  });
  for (const auto& inner : done) EXPECT_EQ(inner, std::vector<int>(7, 1));
}

TEST(ThreadWorkers, AThreadThatCannotStartLeavesTheWorkToTheOthers) {
  for (const std::size_t most : {0U, 1U, 2U}) {
    std::size_t started = 0;
    ThreadWorkers workers(8, [&](std::function<void()> work) {
      if (started == most) {
        throw std::system_error(std::make_error_code(std::errc::resource_unavailable_try_again));
      }
      ++started;
      return std::jthread(std::move(work));
    });
    EXPECT_EQ(workers.threads(), most + 1);
    std::vector<int> done(100, 0);
    workers.For(done.size(), [&](std::size_t round) { ++done[round]; });
    EXPECT_EQ(done, std::vector<int>(100, 1));
  }
}

TEST(ThreadWorkers, OneThreadIsTheCallers) {
  ThreadWorkers workers(1);
  const auto caller = std::this_thread::get_id();
  workers.For(10, [&](std::size_t) { EXPECT_EQ(std::this_thread::get_id(), caller); });
}

TEST(ThreadWorkers, WhatARoundThrowsIsThrownToWhoAskedForIt) {
  ThreadWorkers workers(3);
  for (const std::size_t bad : {0U, 17U, 99U}) {
    EXPECT_THROW(workers.For(100,
                             [&](std::size_t round) {
                               if (round == bad) throw std::bad_alloc();
                             }),
                 std::bad_alloc);
  }
  std::vector<int> done(100, 0);
  workers.For(done.size(), [&](std::size_t round) { ++done[round]; });
  EXPECT_EQ(std::count(done.begin(), done.end(), 1), 100);
}

}  // namespace
}  // namespace bendloop::host
