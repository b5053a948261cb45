// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/service_times.h"

namespace bendloop::host {
namespace {

// A loop that is held up by a busy machine for a few turns is no loop that hangs.
constexpr int kTurnsOfWatchdog = 4;

// The last recording and the last report, on a disk that is well.
constexpr std::chrono::seconds kLastWrites{4};

std::string MsText(std::chrono::nanoseconds time) {
  return std::to_string(time.count() / 1'000'000) + " ms";
}

}  // namespace

hal::Result<void> CheckWatchdog(const ServiceTimes& service) {
  const std::chrono::nanoseconds least = kTurnsOfWatchdog * kLoopPeriod;
  if (service.watchdog.count() == 0 || service.watchdog >= least) return {};
  return hal::Fail(hal::ErrorKind::kUsage,
                   "WatchdogSec of the service (WATCHDOG_USEC): found " + MsText(service.watchdog) +
                       ", expected at least " + MsText(least) +
                       ": a cell that is well would be ended; WatchdogSec=10 is shipped");
}

std::chrono::nanoseconds LongestStop(const config::CellConfig& cell) {
  const config::BenderConfig& bender = cell.bender;
  if (bender.link == config::BenderKind::kNone) return kLastWrites;
  // The answer, then what is active (asked twice where its crc does not fit) and what makes the
  // commit void, each at the last moment.
  const std::chrono::nanoseconds commit =
      bender.connect_timeout + bender.commit_timeout + 5 * bender.response_timeout;
  return commit + kLastWrites;
}

std::string WhyStopIsTooShort(const config::CellConfig& cell, const ServiceTimes& service) {
  const std::chrono::nanoseconds all = LongestStop(cell);
  if (all <= service.stop) return "";
  return "a stop in the middle of a commit may last " + MsText(all) +
         " (commit_timeout_ms, connect_timeout_ms, response_timeout_ms, and " +
         MsText(kLastWrites) + " for the disk), and the service is ended after " +
         MsText(service.stop) + " (" +
         (service.stop_from.empty() ? "as shipped" : service.stop_from) +
         "): raise TimeoutStopSec of bendloopd.service (bendloop check --unit-drop-in does), or "
         "shorten these; what is cut short is settled at the next start";
}

}  // namespace bendloop::host
