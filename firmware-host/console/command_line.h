// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace bendloop::host {

// Before anything is added to `app`: --help in 80 columns, --version and -V with `version`.
void DressCommandLine(CLI::App& app, const std::string& version);

// A number between two limits, which NaN is not: "found nan, expected 0.2 to 300".
CLI::Validator NumberWithin(double low, double high);

// What is wrong with a command line, in one line: the word that nobody knows and the one that may
// have been meant, otherwise CLI11's sentence; then where help is.
std::string WhatIsWrong(const CLI::App& app, const CLI::ParseError& error);

}  // namespace bendloop::host
