// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <csignal>
#include <exception>
#include <iostream>

#include "hal/error.h"
#include "hal/result.h"

namespace bendloop::host {

// main() of a simulator: `run` describes its command line to `app`, parses it and stays until it is
// told to quit. The exit code; errors go to standard error as "NAME: MESSAGE".
inline int SimulatorMain(const char* name, hal::Result<void> (*run)(CLI::App&, int, char**),
                         int argc, char** argv) {
  std::signal(SIGPIPE, SIG_IGN);
  CLI::App app;
  app.name(name);
  hal::Error error;
  try {
    const hal::Result<void> done = run(app, argc, argv);
    if (done) return 0;
    error = done.error();
  } catch (const CLI::ParseError& e) {  // or --help
    return app.exit(e) == 0 ? 0 : hal::ExitCode(hal::ErrorKind::kUsage);
  } catch (const std::exception& e) {
    error = {hal::ErrorKind::kInternal, e.what()};
  }
  std::cerr << name << ": " << error.message << '\n';
  return hal::ExitCode(error.kind);
}

}  // namespace bendloop::host
