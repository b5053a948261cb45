// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <string>
#include <vector>

#include "hal/result.h"

namespace bendloop::host {

// How long bendloop-cad may take. An assembly of 100 MB takes about a minute.
inline constexpr std::chrono::seconds kCadPatience{120};

// Runs bendloop-cad with `arguments` and `input` on its standard input; what it writes on standard
// output. It stands beside this program or in ../libexec/bendloop/; kDevice with the package's name
// where it does not, kBadInput when it dies of `file` or takes longer than `patience`.
hal::Result<std::string> RunCadHelper(const std::vector<std::string>& arguments,
                                      const std::string& input, const std::string& file,
                                      std::chrono::seconds patience = kCadPatience);

}  // namespace bendloop::host
