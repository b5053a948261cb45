// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace bendloop::host {

// What the build makes of the same command line that --help shows, so that neither can lie: `what`
// is
//   man1, man8            the manual page of the program, in that section (roff)
//   man1:COMMAND          of one of its commands
//   commands              the names of its commands, one a line
//   bash, zsh             what the shell completes
// Anything else throws CLI::ValidationError. `version` is the first line of --version.
std::string Manual(const CLI::App& app, const std::string& what, const std::string& version);

// The shells' scripts.
std::string BashCompletion(const CLI::App& app);
std::string ZshCompletion(const CLI::App& app);

}  // namespace bendloop::host
