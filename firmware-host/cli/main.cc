// SPDX-License-Identifier: Apache-2.0
#include <signal.h>

#include <exception>
#include <iostream>

#include "firmware-host/cell/version.h"
#include "firmware-host/cli/command.h"
#include "firmware-host/convert/convert_command.h"

namespace bendloop::host {
namespace {

constexpr const char* kFooter = R"(
Examples:
  bendloop demo                                    everything at once, on simulated hardware
  bendloop reconstruct scan.ply --units m          a cloud to lengths, rotations and angles
  bendloop replay part.session --config cell.toml  a recorded scan through the daemon's own path
  bendloop check cell.toml part.toml               are these files right?
  bendloop COMMAND --help                          more about one of them

Exit codes: 0 done; 1 measured, but refused or out of tolerance; 2 wrong usage; 3 bad input;
4 device or link failure; 5 internal error.)";

int Main(int argc, char** argv) {
  CLI::App app{"bendloop: tube inspection and correction beside a bending cell", "bendloop"};
  app.footer(kFooter);
  app.set_version_flag("--version", kSoftware);
  app.require_subcommand(1);
  Run run;
  AddDemoCommand(app, run);
  AddReconstructCommand(app, run);
  AddReplayCommand(app, run);
  AddSimulateCommand(app, run);
  AddConvertCommand(app, run, std::cin, std::cout, std::cerr);
  AddCheckCommand(app, run);
  AddDoctorCommand(app, run);
  AddStatusCommand(app, run);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error, std::cout, std::cerr);  // help, version
    const auto chosen = app.get_subcommands();
    return Report({hal::ErrorKind::kUsage,
                   std::string(error.what()) + "; try bendloop " +
                       (chosen.empty() ? "" : chosen.front()->get_name() + " ") + "--help"});
  }
  return run ? run() : hal::ExitCode(hal::ErrorKind::kInternal);
}

}  // namespace
}  // namespace bendloop::host

int main(int argc, char** argv) {
  signal(SIGPIPE, SIG_IGN);
  try {
    return bendloop::host::Main(argc, argv);
  } catch (const std::exception& error) {
    return bendloop::host::Report(
        {bendloop::hal::ErrorKind::kInternal,
         std::string("internal error: ") + error.what() + "; please report it"});
  }
}
