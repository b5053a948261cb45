// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include <iostream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "firmware-host/cli/command.h"
#include "firmware-host/cli/state_dir_option.h"
#include "firmware-host/history/history_output.h"
#include "firmware-host/history/history_search.h"
#include "firmware-host/ledger/moment.h"
#include "firmware-host/text/style.h"

namespace bendloop::host {
namespace {

struct HistoryArguments {
  StateDirOption state;
  HistoryFilter filter;
  std::string csv;
  std::string values;
  std::string json;
};

// What a screen takes in; exports are of all.
constexpr std::size_t kShownParts = 20;

constexpr const char* kHistoryFooter = R"(
Examples:
  bendloop history                         the last 20 parts
  bendloop history --part elbow --lot 3    of one lot
  bendloop history --verdict fail --since 7d
  bendloop history --since 2026-11-01 --until 2026-11 --csv november.csv
  bendloop history --values values.csv     every length, rotation and angle, for
                                           a statistics program
  bendloop history --json - --last 1       the last part with its whole result

Times are UTC; --until 2026-11 is the whole month. "worst %" is the greatest
deviation in percent of its tolerance. It only reads, beside a running daemon,
too. Exit codes: 3 no history, or one of another version; 4 the disk.)";

int ListHistory(HistoryArguments arguments) {
  const auto directory = arguments.state.Directory();
  if (!directory) return Report(directory.error());
  HistoryFilter& filter = arguments.filter;
  for (auto [time, option] :
       {std::pair(&filter.since, "--since"), std::pair(&filter.until, "--until")}) {
    auto read = HistoryTime(*time, SystemMoment().unix_ms, option);
    if (!read) return Report(read.error());
    *time = *read;
  }
  const bool exports = !(arguments.csv + arguments.values + arguments.json).empty();
  if (filter.most == 0 && !exports) filter.most = kShownParts;
  const auto reader = HistoryReader::Open(*directory / "history.db");
  if (!reader) return Report(reader.error());
  std::vector<HistoryRow> rows;
  const auto read = reader->Each(filter, [&](const HistoryRow& row) { rows.push_back(row); });
  if (!read) return Report(read.error());
  if (rows.empty()) Note("no part of the history is as asked for");
  if (!exports) {
    std::cout << HistoryText(rows, ColourAllowed(STDOUT_FILENO));
    return 0;
  }
  int code = 0;
  const auto write = [&](const std::string& path, auto text) {
    if (!path.empty() && code == 0) code = WriteOutput(path, text(rows));
  };
  write(arguments.csv, HistoryCsv);
  write(arguments.values, HistoryValuesCsv);
  write(arguments.json, HistoryJson);
  return code;
}

}  // namespace

CLI::App* AddHistoryCommand(CLI::App& app, Run& run) {
  auto arguments = std::make_shared<HistoryArguments>();
  CLI::App* command = app.add_subcommand("history", "The parts of the past: list, filter, export");
  command->footer(kHistoryFooter);
  arguments->state.AddTo(*command);
  HistoryFilter& filter = arguments->filter;
  command->add_option("--part", filter.part, "Only parts of this name")->type_name("NAME");
  command->add_option("--lot", filter.lot, "Only of this lot, as the cell counts them")
      ->type_name("N");
  command->add_option("--verdict", filter.verdict, "Only these: pass, fail, undecided, or none")
      ->check(CLI::IsMember({"pass", "fail", "undecided", "none"}).description(""))
      ->type_name("VERDICT");
  command->add_option("--session", filter.session, "Only this one")->type_name("NAME");
  command->add_option("--since", filter.since, "Not before: 2026-11-22, or 8h or 7d ago")
      ->type_name("TIME");
  command->add_option("--until", filter.until, "Not after")->type_name("TIME");
  command->add_option("--last", filter.most, "The newest so many (20 on the screen, else all)")
      ->check(CLI::Range(1, 1'000'000'000).description(""))
      ->type_name("N");
  command->add_option("--csv", arguments->csv, "A line a part, to this file (-: the screen)")
      ->type_name("FILE");
  command->add_option("--values", arguments->values, "CSV of every judged number, to this file")
      ->type_name("FILE");
  command->add_option("--json", arguments->json, "JSON, schema bendloop.history/1, to this file")
      ->type_name("FILE");
  command->callback([arguments, &run] { run = [arguments] { return ListHistory(*arguments); }; });
  return command;
}

}  // namespace bendloop::host
