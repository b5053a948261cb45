// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <system_error>
#include <vector>

namespace bendloop::hal {

// What lies in `folder`, in no order; where it cannot be read to its end `error` says so, and what
// was found until then comes back. Throws for want of memory, where the standard library's own
// iterator ends the process.
std::vector<std::filesystem::path> PathsIn(const std::filesystem::path& folder,
                                           std::error_code& error);

}  // namespace bendloop::hal
