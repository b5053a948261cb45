// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/trouble_log.h"

#include <algorithm>

namespace bendloop::host {

std::string TroubleLog::Lasted(std::chrono::nanoseconds now) const {
  const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(now - began_).count();
  return std::to_string(seconds) + " s (" + std::to_string(times_) +
         (times_ == 1 ? " time)" : " times)");
}

std::string TroubleLog::Met(const std::string& why, std::chrono::nanoseconds now) {
  ++times_;
  if (times_ == 1) {
    began_ = told_at_ = now;
    reminder_ = kFirstReminder;
    told_ = why;
    return why;
  }
  if (why != told_ && now - told_at_ >= kBetweenReasons) {
    told_at_ = now;
    told_ = why;
    return why;
  }
  if (now - told_at_ < reminder_) return "";
  told_at_ = now;
  told_ = why;
  reminder_ = std::min<std::chrono::nanoseconds>(2 * reminder_, kLongestReminder);
  return why + ", for " + Lasted(now);
}

std::string TroubleLog::Over(std::chrono::nanoseconds now) {
  if (times_ == 0) return "";
  const std::string lasted = " after " + Lasted(now);
  times_ = 0;
  return lasted;
}

}  // namespace bendloop::host
