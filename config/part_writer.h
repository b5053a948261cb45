// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "config/part_config.h"

namespace bendloop::config {

// `part` as a part file that LoadPart reads back to the same values, every key of it. `comment`
// comes first, each line of it behind "# ".
std::string PartToml(const PartConfig& part, const std::string& comment = {});

}  // namespace bendloop::config
