// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <time.h>

#include <chrono>

#include "hal/clock.h"

namespace bendloop::bench {

// Time that the processor spent on this process: what a busy machine changes least.
class CpuClock final : public hal::Clock {
 public:
  std::chrono::nanoseconds Now() const override {
    timespec now{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return std::chrono::seconds(now.tv_sec) + std::chrono::nanoseconds(now.tv_nsec);
  }
  void SleepUntil(std::chrono::nanoseconds) override {}  // nobody sleeps in a benchmark
};

struct Elapsed {
  double wall_ms = 0;
  double cpu_ms = 0;
};

class Stopwatch {
 public:
  Elapsed Read() const {
    using Ms = std::chrono::duration<double, std::milli>;
    return {Ms(wall_.Now() - wall_start_).count(), Ms(cpu_.Now() - cpu_start_).count()};
  }

 private:
  hal::SteadyClock wall_;
  CpuClock cpu_;
  std::chrono::nanoseconds wall_start_ = wall_.Now();
  std::chrono::nanoseconds cpu_start_ = cpu_.Now();
};

}  // namespace bendloop::bench
