// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

namespace bendloop::host {

// What the log says of a trouble that is met again and again, as of a bender that is away and
// looked at four times a second: at once, then at growing intervals while it lasts, and when it is
// over. From one thread; by a clock that nobody sets.
class TroubleLog {
 public:
  // Of the first reminder; each next comes after twice as long.
  static constexpr std::chrono::minutes kFirstReminder{1};
  static constexpr std::chrono::hours kLongestReminder{8};
  // A reason that changes back and forth is told no oftener.
  static constexpr std::chrono::seconds kBetweenReasons{10};

  // It was met, for this reason: what to say, mostly "".
  std::string Met(const std::string& why, std::chrono::nanoseconds now);
  // It was not met: how long it lasted, " after 1250 s (5000 times)"; "" if there was none.
  std::string Over(std::chrono::nanoseconds now);

 private:
  std::string Lasted(std::chrono::nanoseconds now) const;

  std::uint64_t times_ = 0;  // 0: there is none
  std::chrono::nanoseconds began_{0};
  std::chrono::nanoseconds told_at_{0};
  std::chrono::nanoseconds reminder_{kFirstReminder};
  std::string told_;
};

}  // namespace bendloop::host
