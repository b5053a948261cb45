// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <csignal>
#include <exception>
#include <iostream>
#include <string>

#include "firmware-host/console/command_line.h"
#include "firmware-host/console/message.h"
#include "firmware-host/console/standard_output.h"
#include "firmware-host/console/version.h"
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
  DressCommandLine(app, name + BuildText().substr(std::string("bendloop").size()));
  hal::Error error;
  try {
    const hal::Result<void> done = run(app, argc, argv);
    if (done) return FinishOutput(name, 0);
    error = done.error();
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) {  // --help, --version
      app.exit(e, std::cout, std::cerr);
      return FinishOutput(name, 0);
    }
    error = {hal::ErrorKind::kUsage, WhatIsWrong(app, e)};
  } catch (const std::exception& e) {
    error = {hal::ErrorKind::kInternal, e.what()};
  }
  TellPerson(name, error.message);
  return hal::ExitCode(error.kind);
}

}  // namespace bendloop::host
