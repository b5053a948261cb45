// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "config/cell_config.h"
#include "firmware-host/cli/doctor.h"

namespace bendloop::host {

// What an installed system is asked besides; tests give made-up answers.
struct InstalledPlaces {
  DoctorPlaces machine;
  std::filesystem::path etc = "/etc";
  std::filesystem::path run = "/run";
  std::filesystem::path local_lib = "/usr/local/lib";
  std::filesystem::path usr_lib = "/usr/lib";
  // The first line that a command prints; "": none.
  std::function<std::string(const std::string&)> first_line_of;
  // Whether this user may read and write a device.
  std::function<bool(const std::filesystem::path&)> may_use;
};
InstalledPlaces SystemPlaces();

// All that follows, and the machine, whose disk is that of the cell's state directory. `cell_file`
// "": the installed one, if there is one. A file that is wrong is a finding.
std::vector<Finding> ExamineAll(InstalledPlaces places, std::filesystem::path cell_file = {});
// Is bendloop installed here as it should be: service, unit, user, udev rule?
std::vector<Finding> ExamineInstalled(const InstalledPlaces& places);
// May this user open what the cell file names: scanner, bender, state directory?
std::vector<Finding> ExamineCell(const InstalledPlaces& places, const config::CellConfig& cell);

}  // namespace bendloop::host
