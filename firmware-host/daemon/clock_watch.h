// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <optional>

#include "firmware-host/ledger/moment.h"

namespace bendloop::host {

// Sees when somebody sets the clock of this machine: the wall clock moves and the other does not.
class ClockWatch {
 public:
  // A time server moves a clock by less than this once it runs.
  static constexpr std::int64_t kStepMs = 60'000;

  // By how many hours it was set since the last call; empty: it was not.
  std::optional<double> Step(const Moment& now) {
    const std::int64_t difference_ms = now.unix_ms - now.boot_ns / 1'000'000;
    const std::int64_t step_ms = difference_ms - last_ms_.value_or(difference_ms);
    last_ms_ = difference_ms;
    if (std::abs(static_cast<double>(step_ms)) <= kStepMs) return std::nullopt;
    return static_cast<double>(step_ms) / 3.6e6;
  }

 private:
  std::optional<std::int64_t> last_ms_;
};

}  // namespace bendloop::host
