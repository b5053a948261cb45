// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include <algorithm>
#include <iostream>
#include <memory>
#include <utility>

#include "config/load.h"
#include "firmware-host/cli/command.h"
#include "firmware-host/cli/doctor.h"
#include "firmware-host/cli/doctor_cell.h"
#include "firmware-host/console/terminal.h"
#include "firmware-host/console/wrap.h"
#include "firmware-host/result/json.h"
#include "firmware-host/text/progress.h"
#include "firmware-host/text/style.h"
#include "firmware-host/text/table.h"

namespace bendloop::host {
namespace {

struct DoctorArguments {
  std::string config;
  bool json = false;
};

constexpr const char* kDoctorFooter = R"(
Examples:
  bendloop doctor
  bendloop doctor --config cell.toml
  sudo -u bendloop bendloop doctor --json

Run it as the user that runs the daemon. Warnings do not change the exit code:
which of them matter depends on the cell: that of /etc/bendloop/cell.toml, where
no other is named.)";

int Doctor(const DoctorArguments& arguments) {
  if (!arguments.config.empty()) {
    const auto cell = config::LoadCell(arguments.config);
    if (!cell) return Report(cell.error());
  }
  const std::vector<Finding> findings = ExamineAll(SystemPlaces(), arguments.config);
  if (arguments.json) {
    std::cout << FindingsJson(findings);
    return 0;
  }
  std::cout << FindingsText(findings, ColourAllowed(STDOUT_FILENO), TerminalColumns(STDOUT_FILENO));
  return 0;
}

}  // namespace

std::string FindingsJson(const std::vector<Finding>& findings) {
  Json list = Json::array();
  for (const Finding& finding : findings) {
    list.push_back({{"name", finding.name},
                    {"ok", finding.ok},
                    {"found", finding.found},
                    {"mend", finding.mend}});
  }
  return Dump({{"schema", "bendloop.doctor/1"}, {"findings", list}}, 2) + "\n";
}

std::string FindingsText(const std::vector<Finding>& findings, bool colour, std::size_t columns) {
  constexpr std::size_t kFewest = 20;  // a terminal narrower than its names breaks the lines itself
  std::size_t names = 0;
  for (const Finding& finding : findings) names = std::max(names, finding.name.size());
  const std::size_t taken = 2 + 4 + 2 + names + 2;  // indent, "warn", gaps
  const std::size_t room = columns > taken + kFewest ? columns - taken : kFewest;
  Table table({{"", Align::kLeft}, {"what", Align::kLeft}, {"found", Align::kLeft}});
  for (const Finding& finding : findings) {
    Cell state(finding.ok ? "ok" : "warn", finding.ok ? Style::kGood : Style::kWarning);
    Cell name = finding.name;
    for (const std::string& line : WrapWords(finding.found, room)) {
      table.Add({std::exchange(state, ""), std::exchange(name, ""), line});
    }
    if (finding.ok) continue;
    for (const std::string& line : WrapWords(finding.mend, room)) {
      table.Add({"", "", Cell(line, Style::kFaint)});
    }
  }
  return table.Render(colour);
}

CLI::App* AddDoctorCommand(CLI::App& app, Run& run) {
  auto arguments = std::make_shared<DoctorArguments>();
  CLI::App* command = app.add_subcommand("doctor", "Is this machine fit, and all in its place?");
  command->footer(kDoctorFooter);
  command
      ->add_option("--config", arguments->config,
                   "Looks at what this cell needs, not the installed one")
      ->type_name("CELL.toml");
  command->add_flag("--json", arguments->json, "JSON, schema bendloop.doctor/1");
  command->callback([arguments, &run] { run = [arguments] { return Doctor(*arguments); }; });
  return command;
}

}  // namespace bendloop::host
