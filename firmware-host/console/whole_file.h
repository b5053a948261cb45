// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

#include "hal/result.h"

namespace bendloop::host {

// kBadInput when it cannot be read or is larger than `most_bytes`.
hal::Result<std::string> ReadWholeFile(const std::filesystem::path& path,
                                       std::size_t most_bytes = 64u << 20);

}  // namespace bendloop::host
