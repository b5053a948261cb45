// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <filesystem>
#include <optional>
#include <string_view>
#include <vector>

#include "firmware-host/cell/service_times.h"

namespace bendloop::host {

inline constexpr const char* kUnitName = "bendloopd.service";

// Where systemd looks for units, in systemd/system each; tests give a made-up tree.
struct UnitPlaces {
  std::filesystem::path etc = "/etc";
  std::filesystem::path run = "/run";
  std::filesystem::path local_lib = "/usr/local/lib";
  std::filesystem::path usr_lib = "/usr/lib";
};

// Every file of the service's unit: systemd takes the first, and leaves the others unread.
std::vector<std::filesystem::path> UnitFiles(const UnitPlaces& places = {});

// How long a stop may last by the unit that is installed here and its drop-ins, and which file says
// so; that of the shipped unit where none is. Of the files, as the daemon sees them: its root
// folder has no /run, and the bus is not for it.
ServiceTimes TimesOfUnit(const UnitPlaces& places = {});

// As systemd reads a time: "90", "1min 30s", "infinity" (the longest there is). Nothing: it reads
// none.
std::optional<std::chrono::nanoseconds> TimeSpan(std::string_view text);

}  // namespace bendloop::host
