// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <iosfwd>

namespace bendloop::host {

// Adds `bendloop convert` to the command line. When the user chose it, parsing sets `run` to a
// function that does the work on these streams and returns the exit code: 0 done, 2 wrong usage,
// 3 bad input. The streams must live until then. One call hooks it in:
//
//   std::function<int()> run;
//   AddConvertCommand(app, run, std::cin, std::cout, std::cerr);
//   CLI11_PARSE(app, argc, argv);
//   return run ? run() : 2;
CLI::App* AddConvertCommand(CLI::App& app, std::function<int()>& run, std::istream& in,
                            std::ostream& out, std::ostream& err);

}  // namespace bendloop::host
