// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "config/cell_config.h"
#include "firmware-host/cli/demo/demo.h"
#include "hal/result.h"

namespace bendloop::host {

// The demo's folder: cell.toml, part.toml, register-map.toml, first-program.json. It is the cell's
// state_dir as well, so results/, sessions/ and the rest come to stand beside them.
// For a bender on CAN there is live-cell.toml with what it names, for the daemon; a replay takes
// cell.toml all the same, and simulates the bender itself.
// What an earlier demo left there is removed; a folder with anything else in it is kUsage.
hal::Result<void> WriteDemoFiles(const DemoOptions& options);

// The cell file that the daemon runs.
std::filesystem::path LiveCellFile(const DemoOptions& options);

// The demo's node on a CAN bus.
inline constexpr int kDemoNodeId = 5;

// The program that the bender starts with: the part's nominal with its material made up for.
hal::Result<void> WriteFirstProgram(const std::filesystem::path& out,
                                    const config::CellConfig& cell);

}  // namespace bendloop::host
