// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>

#include "hal/result.h"

namespace bendloop::host {

// Which daemon's state directory a command is about: of its cell file, or named itself.
struct StateDirOption {
  std::string config;
  std::string state_dir = "/var/lib/bendloop";

  // Both options; they outlive the command.
  void AddTo(CLI::App& command);
  // kBadInput where the cell file is none.
  hal::Result<std::filesystem::path> Directory() const;
};

}  // namespace bendloop::host
