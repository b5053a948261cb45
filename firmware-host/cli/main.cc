// SPDX-License-Identifier: Apache-2.0
#include <signal.h>

#include <exception>
#include <iostream>
#include <string>
#include <vector>

#include "firmware-host/cad/export_command.h"
#include "firmware-host/cad/nominal_command.h"
#include "firmware-host/cli/command.h"
#include "firmware-host/console/command_line.h"
#include "firmware-host/console/standard_output.h"
#include "firmware-host/console/version.h"
#include "firmware-host/convert/convert_command.h"

namespace bendloop::host {
namespace {

constexpr const char* kFooter = R"(
Examples:
  bendloop demo                            everything, on simulated hardware
  bendloop reconstruct scan.ply --units m  a cloud to lengths, rotations, angles
  bendloop replay part.session --config cell.toml
                                           a recorded scan, the daemon's own way
  bendloop check cell.toml part.toml       are these files right?
  bendloop COMMAND --help                  more about one of them

Exit codes: 0 done; 1 measured, but refused or out of tolerance; 2 wrong usage;
3 bad input; 4 device or link failure; 5 internal error.)";

// The words of the command line from the last to the first, as CLI11 takes them. `help COMMAND` is
// `COMMAND --help`.
std::vector<std::string> WordsOf(int argc, char** argv) {
  std::vector<std::string> words(argv + 1, argv + argc);
  if (!words.empty() && words.front() == "help") {
    words.erase(words.begin());
    words.insert(words.begin() + (words.empty() ? 0 : 1), "--help");
  }
  return {words.rbegin(), words.rend()};
}

int Main(int argc, char** argv) {
  CLI::App app{"bendloop: tube inspection and correction beside a bending cell", "bendloop"};
  DressCommandLine(app, BuildText());
  app.footer(kFooter);
  app.require_subcommand(1);
  Run run;
  AddDemoCommand(app, run);
  AddReconstructCommand(app, run);
  AddFeaturesCommand(app, run);
  AddReplayCommand(app, run);
  AddSimulateCommand(app, run);
  AddConvertCommand(app, run, std::cin, std::cout, std::cerr);
  AddNominalCommand(app, run, std::cout, std::cerr);
  AddExportCommand(app, run, std::cerr);
  AddCheckCommand(app, run);
  AddDoctorCommand(app, run);
  AddSupportCommand(app, run);
  AddAcceptanceCommand(app, run);
  AddStatusCommand(app, run);
  AddHistoryCommand(app, run);
  AddReportCommand(app, run);
  AddLotCommand(app, run);
  AddUndoCommand(app, run);
  AddFirstProgramCommand(app, run);
  AddAcknowledgeCommand(app, run);
  try {
    app.parse(WordsOf(argc, argv));
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error, std::cout, std::cerr);  // help, version
    return Report({hal::ErrorKind::kUsage, WhatIsWrong(app, error)});
  }
  return run ? run() : hal::ExitCode(hal::ErrorKind::kInternal);
}

}  // namespace
}  // namespace bendloop::host

int main(int argc, char** argv) {
  signal(SIGPIPE, SIG_IGN);
  try {
    return bendloop::host::FinishOutput("bendloop", bendloop::host::Main(argc, argv));
  } catch (const std::exception& error) {
    return bendloop::host::Report(
        {bendloop::hal::ErrorKind::kInternal,
         std::string("internal error: ") + error.what() + "; please report it"});
  }
}
