// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>

namespace bendloop::host {

// How old things are that were made one after the other, by a clock that may have been set: the sum
// of the times between neighbours, of which none counts as less than nothing or as more than
// kMostStepDays. So a clock that jumps by a year either way makes nothing a year older at once, and
// a machine that stood still for a year keeps what it has for longer.
class Age {
 public:
  static constexpr double kMostStepDays = 14;

  explicit Age(std::int64_t now_ms) : later_ms_(now_ms) {}

  // Of the next older one, which was made then.
  double DaysOf(std::int64_t made_ms) {
    constexpr double kMsADay = 86'400'000;
    days_ += std::clamp(static_cast<double>(later_ms_ - made_ms) / kMsADay, 0.0, kMostStepDays);
    later_ms_ = made_ms;
    return days_;
  }

 private:
  std::int64_t later_ms_;
  double days_ = 0;
};

}  // namespace bendloop::host
