// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "firmware-host/cloud/point_cloud.h"
#include "hal/result.h"

namespace bendloop::host {

// The cloud that a command works on: a file, or "-" for standard input, and its unit.
struct CloudArgument {
  std::string file;
  std::string units = "mm";

  // Positional CLOUD, and --units.
  void AddTo(CLI::App& command);
  hal::Result<PointCloud> Read() const;
  bool is_standard_input() const { return file == "-"; }
};

}  // namespace bendloop::host
