// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace bendloop::host {

// One thing that the daemon wants of the machine.
struct Finding {
  std::string name;
  bool ok = false;
  std::string found;
  std::string mend;  // how to grant it; "" when ok
};

Finding Good(std::string name, std::string found);
Finding Bad(std::string name, std::string found, std::string mend);
// Of a file of the kernel's, which often is all of it; "" where there is none.
std::string FirstLine(const std::filesystem::path& path);

// Where to look; tests give a made-up tree.
struct DoctorPlaces {
  std::filesystem::path proc = "/proc";
  std::filesystem::path sys = "/sys";
  std::filesystem::path dev = "/dev";
  std::filesystem::path state_dir = "/var/lib/bendloop";
};

std::vector<Finding> Examine(const DoctorPlaces& places);

// Schema "bendloop.doctor/1".
std::string FindingsJson(const std::vector<Finding>& findings);

// The findings as a table of at most `columns`; what is long is broken.
std::string FindingsText(const std::vector<Finding>& findings, bool colour, std::size_t columns);

}  // namespace bendloop::host
