// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <utility>

#include "config/cell_config.h"
#include "firmware-host/cli/demo/demo.h"
#include "hal/result.h"

namespace bendloop::host {

// Holds a demo's folder against a second demo, until the process ends or this object does.
class DemoLock {
 public:
  explicit DemoLock(int descriptor) : descriptor_(descriptor) {}
  DemoLock(DemoLock&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)) {}
  DemoLock& operator=(DemoLock&&) = delete;
  ~DemoLock();

 private:
  int descriptor_;
};

// Creates the folder where there is none and takes it. kUsage when another demo runs in it, or when
// it holds files that are not of a demo.
hal::Result<DemoLock> LockDemoFolder(const std::filesystem::path& out);

// The demo's folder: cell.toml, part.toml, register-map.toml, first-program.json. It is the cell's
// state_dir as well, so results/, sessions/ and the rest come to stand beside them.
// For a bender on CAN there is live-cell.toml with what it names, for the daemon; a replay takes
// cell.toml all the same, and simulates the bender itself.
// What an earlier demo left there is removed. The folder must be locked.
hal::Result<void> WriteDemoFiles(const DemoOptions& options);

// Of a demo that ended early: recordings that were never closed, each with its log and its index.
void RemoveUnfinished(const std::filesystem::path& out);

// The cell file that the daemon runs.
std::filesystem::path LiveCellFile(const DemoOptions& options);

// The demo's node on a CAN bus.
inline constexpr int kDemoNodeId = 5;

// The program that the bender starts with: the part's nominal with its material made up for.
hal::Result<void> WriteFirstProgram(const std::filesystem::path& out,
                                    const config::CellConfig& cell);

}  // namespace bendloop::host
