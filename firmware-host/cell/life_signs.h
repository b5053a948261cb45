// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <limits>

#include "hal/clock.h"

namespace bendloop::host {

// Writing a result, the history and the lot: a disk that takes longer has failed.
inline constexpr std::chrono::seconds kDiskBound{30};

// What tells a watchdog that work which may last goes on: whoever works says before each step how
// long it may take, and who feeds the watchdog does so only within that time. A step that hangs
// starves it.
class LifeSigns {
 public:
  explicit LifeSigns(const hal::Clock& clock) : clock_(clock) {}

  // The step that begins now takes at most `bound`.
  void Expect(std::chrono::nanoseconds bound) { deadline_ns_ = (clock_.Now() + bound).count(); }
  // Nothing is being waited for.
  void Rest() { deadline_ns_ = kNever; }
  bool InTime() const { return clock_.Now().count() <= deadline_ns_; }

 private:
  static constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();
  const hal::Clock& clock_;
  std::atomic<std::int64_t> deadline_ns_{kNever};
};

}  // namespace bendloop::host
