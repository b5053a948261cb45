// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>

#include "hal/clock.h"

namespace bendloop::tests {

// Moves only when it is told, from any thread.
class HandClock final : public hal::Clock {
 public:
  std::chrono::nanoseconds Now() const override { return std::chrono::nanoseconds(now_ns_); }
  void SleepUntil(std::chrono::nanoseconds deadline) override {
    if (deadline > Now()) now_ns_ = deadline.count();
  }
  void Advance(std::chrono::nanoseconds by) { now_ns_ += by.count(); }

 private:
  std::atomic<std::int64_t> now_ns_{1};
};

}  // namespace bendloop::tests
