// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <iosfwd>

namespace bendloop::host {

// `bendloop nominal`: a tube's nominal from a STEP or IGES file. Choosing it sets `run`.
CLI::App* AddNominalCommand(CLI::App& app, std::function<int()>& run, std::ostream& out,
                            std::ostream& err);

}  // namespace bendloop::host
