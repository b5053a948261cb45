// SPDX-License-Identifier: Apache-2.0
#include "hal/clock.h"

#include <cerrno>
#include <ctime>

namespace bendloop::hal {
namespace {
constexpr long kNanosecondsPerSecond = 1'000'000'000;
}

std::chrono::nanoseconds SteadyClock::Now() const {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return std::chrono::seconds(t.tv_sec) + std::chrono::nanoseconds(t.tv_nsec);
}

void SteadyClock::SleepUntil(std::chrono::nanoseconds deadline) {
  const timespec t{deadline.count() / kNanosecondsPerSecond,
                   deadline.count() % kNanosecondsPerSecond};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr) == EINTR) {
  }
}

}  // namespace bendloop::hal
