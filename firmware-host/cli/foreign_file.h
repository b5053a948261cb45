// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace bendloop::host {

// Why the file can be none that `bendloop check` takes, by its size, its first bytes and its name,
// with the mend; empty: it may be one, or cannot be read.
std::string WhyForeign(const std::string& file);

}  // namespace bendloop::host
