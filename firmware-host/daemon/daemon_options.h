// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "config/cell_config.h"
#include "hal/result.h"

namespace bendloop::host {

struct Endpoint {
  std::string host;
  std::uint16_t port = 0;
};

// "127.0.0.1:7420"; kUsage names what is wrong. `what` is the option.
hal::Result<Endpoint> ParseEndpoint(const std::string& text, const std::string& what);

// The command line of bendloopd.
struct DaemonOptions {
  std::filesystem::path config;
  std::optional<Endpoint> bender;          // instead of what the cell file says
  std::optional<Endpoint> scanner;         // the same
  std::optional<std::string> usb_scanner;  // the same: its serial number, "" for the only one
  std::uint64_t parts = 0;                 // end after so many scans; 0: never
  std::uint16_t status_port = 0;           // 0: any free one
  bool check_only = false;
};

// Parses argv; empty: the text asked for (help, version) was printed. kUsage otherwise.
hal::Result<std::optional<DaemonOptions>> ParseDaemonOptions(int argc, char** argv);

// The cell with the overrides of the command line. What it measures and sends stays the same, and
// so does its digest.
void ApplyOverrides(const DaemonOptions& options, config::CellConfig& cell);

}  // namespace bendloop::host
