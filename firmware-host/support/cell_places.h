// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "config/cell_config.h"
#include "hal/result.h"

namespace bendloop::host {

// The places that a cell file names: its part, map and dictionary, state directory and recordings.
// One that is wrong is what a bundle is made for: of it, too, as far as its text tells; then
// `notes` gets what is wrong. kBadInput where it cannot be read at all.
hal::Result<config::CellConfig> PlacesOfCell(const std::filesystem::path& file,
                                             std::vector<std::string>& notes);

// The cell file's text with the files that it names by where they are in the bundle.
std::string WithBundledPaths(const std::string& cell_text);

}  // namespace bendloop::host
