// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

namespace bendloop::hal {

// Time as the loops see it, so that tests and replays can drive it by hand.
class Clock {
 public:
  virtual ~Clock() = default;
  // Monotonic time since an arbitrary origin.
  virtual std::chrono::nanoseconds Now() const = 0;
  // Returns at `deadline` on this clock's time axis (at once if it has passed).
  virtual void SleepUntil(std::chrono::nanoseconds deadline) = 0;

  void SleepFor(std::chrono::nanoseconds duration) { SleepUntil(Now() + duration); }
};

// CLOCK_MONOTONIC.
class SteadyClock final : public Clock {
 public:
  std::chrono::nanoseconds Now() const override;
  void SleepUntil(std::chrono::nanoseconds deadline) override;
};

// Stands still until it is told: SleepUntil moves it forward at once. For tests.
class ManualClock final : public Clock {
 public:
  std::chrono::nanoseconds Now() const override { return now_; }
  void SleepUntil(std::chrono::nanoseconds deadline) override {
    if (deadline > now_) now_ = deadline;
  }
  void Advance(std::chrono::nanoseconds by) { now_ += by; }

 private:
  std::chrono::nanoseconds now_{0};
};

}  // namespace bendloop::hal
