// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cli/cloud_argument.h"

namespace bendloop::host {

void CloudArgument::AddTo(CLI::App& command) {
  command.add_option("cloud", file, "PLY, PCD or XYZ/CSV text; - is standard input")
      ->required()
      ->type_name("CLOUD");
  command.add_option("--units", units, "Unit of the cloud's coordinates")
      ->check(CLI::IsMember({"mm", "m", "in"}))
      ->capture_default_str();
}

hal::Result<PointCloud> CloudArgument::Read() const {
  const auto unit = UnitsFromName(units);
  if (!unit) return hal::Fail(unit.error());
  return ReadCloud(is_standard_input() ? "/dev/stdin" : file, *unit);
}

}  // namespace bendloop::host
