// SPDX-License-Identifier: Apache-2.0
#include <filesystem>
#include <iostream>
#include <memory>
#include <string>

#include "firmware-host/cli/command.h"
#include "firmware-host/cli/doctor.h"
#include "firmware-host/cli/doctor_cell.h"
#include "firmware-host/support/support_bundle.h"

namespace bendloop::host {
namespace {

struct SupportArguments {
  SupportBundleOptions bundle;
  std::string config = "/etc/bendloop/cell.toml";
  std::string log;
  std::string out = "bendloop-support.tar.gz";
};

constexpr const char* kSupportFooter = R"(
Examples:
  sudo bendloop support-bundle
  bendloop support-bundle --config cell.toml --sessions 5 --out fault.tar.gz
  bendloop replay fault.tar.gz             what the daemon made of the newest scan

Settings, the service's log, journal, history, status, doctor, the newest
results and recordings: one tar for whoever shall find out what is the matter.
It only reads; of a cell file that is wrong, too. No secrets are in it, but
names of parts, tubes and users are, and addresses. Exit codes: 3 no cell file;
4 the tar cannot be written.)";

int MakeBundle(SupportArguments arguments) {
  arguments.bundle.config = arguments.config;
  arguments.bundle.log = arguments.log;
  arguments.bundle.findings = FindingsJson(ExamineAll(SystemPlaces(), arguments.config));
  const auto notes = WriteSupportBundle(arguments.out, arguments.bundle);
  if (!notes) return Report(notes.error());
  for (const std::string& note : *notes) Note("not in it: " + note);
  std::error_code error;
  std::cout << arguments.out << ": " << (std::filesystem::file_size(arguments.out, error) >> 10)
            << " kB\n";
  return 0;
}

}  // namespace

CLI::App* AddSupportCommand(CLI::App& app, Run& run) {
  auto arguments = std::make_shared<SupportArguments>();
  CLI::App* command =
      app.add_subcommand("support-bundle", "All that support needs to know of this cell, in a tar");
  command->footer(kSupportFooter);
  command->add_option("--config", arguments->config, "The daemon's cell file")
      ->type_name("CELL.toml")
      ->capture_default_str();
  command->add_option("--sessions", arguments->bundle.sessions, "The newest so many recordings")
      ->check(CLI::Range(0, 1000).description(""))
      ->type_name("N")
      ->capture_default_str();
  command->add_option("--log", arguments->log, "This log, not the one of the service manager")
      ->type_name("FILE");
  command->add_option("--out", arguments->out, "The tar")
      ->type_name("FILE.tar.gz")
      ->capture_default_str();
  command->callback([arguments, &run] { run = [arguments] { return MakeBundle(*arguments); }; });
  return command;
}

}  // namespace bendloop::host
