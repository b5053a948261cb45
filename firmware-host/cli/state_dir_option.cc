// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cli/state_dir_option.h"

#include "config/load.h"

namespace bendloop::host {

void StateDirOption::AddTo(CLI::App& command) {
  auto* file =
      command.add_option("--config", config, "The daemon's cell file")->type_name("CELL.toml");
  command.add_option("--state-dir", state_dir, "The daemon's state directory")
      ->type_name("DIR")
      ->capture_default_str()
      ->excludes(file);
}

hal::Result<std::filesystem::path> StateDirOption::Directory() const {
  if (config.empty()) return std::filesystem::path(state_dir);
  const auto cell = config::LoadCell(config);
  if (!cell) return hal::Fail(cell.error());
  return cell->state_dir;
}

}  // namespace bendloop::host
