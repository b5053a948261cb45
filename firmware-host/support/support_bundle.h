// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "hal/result.h"

namespace bendloop::host {

struct SupportBundleOptions {
  std::filesystem::path config;  // the cell file
  std::filesystem::path log;     // "": what the service manager kept of bendloopd
  std::string findings;          // of `bendloop doctor --json`
  std::size_t sessions = 1;      // the newest recordings; 0: none
  std::size_t results = 20;      // the newest
};

// Writes a bundle for who shall find out what is the matter with a cell, README.md says what is in
// it. Returns what could not be put into it, a sentence each: a bundle of half a machine, or of a
// cell file that is wrong, is better than none. kBadInput where the cell file cannot be read at
// all; kDevice where `out` cannot be written.
hal::Result<std::vector<std::string>> WriteSupportBundle(const std::filesystem::path& out,
                                                         const SupportBundleOptions& options);

// Where things are in an unpacked bundle.
struct UnpackedBundle {
  std::filesystem::path cell;     // the cell file
  std::filesystem::path session;  // the newest recording, or the one that is named
};
// `session` "": the newest. kBadInput where it is no bundle, or has no such recording.
hal::Result<UnpackedBundle> UnpackSupportBundle(const std::filesystem::path& tar,
                                                const std::filesystem::path& into,
                                                const std::string& session);

}  // namespace bendloop::host
