// SPDX-License-Identifier: Apache-2.0
#include <cstdint>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <sstream>
#include <string>

#include "config/load.h"
#include "firmware-host/cell/cell_status.h"
#include "firmware-host/cli/command.h"
#include "firmware-host/console/printable.h"
#include "firmware-host/daemon/status_client.h"

namespace bendloop::host {
namespace {

struct StatusArguments {
  std::string config;
  std::string state_dir = "/var/lib/bendloop";
  std::optional<std::uint16_t> port;
  bool json = false;
};

constexpr const char* kStatusFooter = R"(
Examples:
  bendloop status
  bendloop status --config /etc/bendloop/cell.toml
  bendloop status --state-dir /var/lib/bendloop --json

Exit code 4 when no daemon answers.)";

int Status(const StatusArguments& arguments) {
  std::filesystem::path directory = arguments.state_dir;
  if (!arguments.config.empty()) {
    const auto cell = config::LoadCell(arguments.config);
    if (!cell) return Report(cell.error());
    directory = cell->state_dir;
  }
  const auto status =
      arguments.port ? FetchStatus(*arguments.port) : FetchStatus(directory / "status.json");
  if (!status) return Report(status.error());
  if (arguments.json) {
    std::cout << Dump(*status, 2) << "\n";
    return 0;
  }
  // Names of devices and files stand in it, which must not move the cursor.
  std::istringstream lines(StatusText(*status));
  for (std::string line; std::getline(lines, line);) std::cout << Printable(line) << "\n";
  return 0;
}

}  // namespace

CLI::App* AddStatusCommand(CLI::App& app, Run& run) {
  auto arguments = std::make_shared<StatusArguments>();
  CLI::App* command = app.add_subcommand("status", "The running daemon's state and health");
  command->footer(kStatusFooter);
  auto* config = command->add_option("--config", arguments->config, "The daemon's cell file")
                     ->type_name("CELL.toml");
  command->add_option("--state-dir", arguments->state_dir, "The daemon's state directory")
      ->type_name("DIR")
      ->capture_default_str()
      ->excludes(config);
  command
      ->add_option("--port", arguments->port,
                   "Ask this port of this machine, whoever may read the state directory")
      ->check(CLI::Range(1, 65535).description(""))
      ->type_name("PORT");
  command->add_flag("--json", arguments->json, "JSON, schema bendloop.status/1");
  command->callback([arguments, &run] { run = [arguments] { return Status(*arguments); }; });
  return command;
}

}  // namespace bendloop::host
