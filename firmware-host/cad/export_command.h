// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <iosfwd>

namespace bendloop::host {

// `bendloop export`: a tube as STEP, DXF or a CSV of its corners. Choosing it sets `run`.
CLI::App* AddExportCommand(CLI::App& app, std::function<int()>& run, std::ostream& err);

}  // namespace bendloop::host
