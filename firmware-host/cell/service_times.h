// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <string>

#include "config/cell_config.h"
#include "hal/result.h"

namespace bendloop::host {

// What the service manager grants: those of systemd/bendloopd.service, unless it says others.
struct ServiceTimes {
  std::chrono::nanoseconds watchdog = std::chrono::seconds(10);  // WatchdogSec; 0: none
  std::chrono::nanoseconds stop = std::chrono::seconds(20);      // TimeoutStopSec
  std::string stop_from = {};  // the file that says so; "": the shipped unit
};

// The cell loop turns at least as often, whatever it waits for: that alone feeds the watchdog.
inline constexpr std::chrono::milliseconds kLoopPeriod{50};

// kUsage where a cell that is well would be taken for one that hangs.
hal::Result<void> CheckWatchdog(const ServiceTimes& service);

// The longest that a stop in the middle of a commit may last, with the last writes to the disk.
std::chrono::nanoseconds LongestStop(const config::CellConfig& cell);

// Empty, or why the service manager may end the daemon in the middle of a commit when it is asked
// to stop, with the mend.
std::string WhyStopIsTooShort(const config::CellConfig& cell, const ServiceTimes& service);

}  // namespace bendloop::host
