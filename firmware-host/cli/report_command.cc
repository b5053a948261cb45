// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <filesystem>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "firmware-host/cli/command.h"
#include "firmware-host/cli/state_dir_option.h"
#include "firmware-host/console/whole_file.h"
#include "firmware-host/daemon/state_store.h"
#include "firmware-host/report/report.h"
#include "firmware-host/result/result_json.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

struct ReportArguments {
  StateDirOption state;
  std::vector<std::string> results;
  std::string out = "report.html";
  std::size_t last = 20;
};

constexpr const char* kReportFooter = R"(
Examples:
  bendloop report                          the last 20 parts of this machine
  bendloop report --last 5 --out today.html
  bendloop report part-0041 part-0042      these parts
  bendloop report /tmp/part-0007.json --out part.html

One page that opens in a browser without a network: tube, rows, interlocks and
the trend from part to part. It is made of the results, which keep no scanned
points; the page that the daemon writes at each so many parts ([storage]
report_every_parts) has these, too. Exit codes: 3 no result, or a bad one; 4 the
disk.)";

// The newest of `directory` that were measured, oldest first.
std::vector<fs::path> NewestResults(const fs::path& directory) {
  std::vector<std::pair<unsigned, fs::path>> found;
  std::error_code error;
  for (fs::directory_iterator it(directory, error), end; !error && it != end; it.increment(error)) {
    const unsigned number = NumberInName(it->path().filename().string());
    if (number > 0 && it->path().extension() == ".json") found.emplace_back(number, it->path());
  }
  std::sort(found.begin(), found.end());
  std::vector<fs::path> paths;
  for (auto& [number, path] : found) paths.push_back(std::move(path));
  return paths;
}

hal::Result<RunResult> ReadRun(const fs::path& path) {
  const auto text = ReadWholeFile(path);
  if (!text) return hal::Fail(text.error());
  return ReadResultJson(*text, path.string());
}

hal::Result<std::vector<RunResult>> NamedRuns(const ReportArguments& arguments,
                                              const fs::path& results) {
  std::vector<RunResult> runs;
  for (const std::string& name : arguments.results) {
    std::error_code error;
    const bool is_file = fs::exists(name, error);
    auto run = ReadRun(is_file ? fs::path(name) : results / (name + ".json"));
    if (!run) return hal::Fail(run.error());
    runs.push_back(std::move(*run));
  }
  return runs;
}

// Scans that failed have no result and are passed over.
std::vector<RunResult> NewestRuns(std::size_t count, const fs::path& results) {
  const std::vector<fs::path> paths = NewestResults(results);
  std::vector<RunResult> runs;
  for (auto path = paths.rbegin(); path != paths.rend() && runs.size() < count; ++path) {
    if (auto run = ReadRun(*path)) runs.push_back(std::move(*run));
  }
  std::reverse(runs.begin(), runs.end());
  return runs;
}

int MakeReport(const ReportArguments& arguments) {
  fs::path results;
  if (auto directory = arguments.state.Directory()) {
    results = *directory / "results";
  } else {
    return Report(directory.error());
  }
  std::vector<RunResult> runs;
  if (arguments.results.empty()) {
    runs = NewestRuns(arguments.last, results);
  } else if (auto named = NamedRuns(arguments, results)) {
    runs = std::move(*named);
  } else {
    return Report(named.error());
  }
  if (runs.empty()) {
    return Report({hal::ErrorKind::kBadInput,
                   results.string() + ": no result of a part there; name the files, or say "
                                      "--config or --state-dir"});
  }
  const int code = WriteOutput(arguments.out, ReportHtml(runs));
  if (code == 0 && arguments.out != "-") {
    std::cout << arguments.out << ": " << runs.size() << (runs.size() == 1 ? " part" : " parts")
              << ", " << runs.front().session << " to " << runs.back().session << "\n";
  }
  return code;
}

}  // namespace

CLI::App* AddReportCommand(CLI::App& app, Run& run) {
  auto arguments = std::make_shared<ReportArguments>();
  CLI::App* command = app.add_subcommand("report", "The HTML report of parts of the past");
  command->footer(kReportFooter);
  command->add_option("RESULT", arguments->results, "Files, or names of parts of the cell");
  arguments->state.AddTo(*command);
  command->add_option("--last", arguments->last, "Without names: the newest so many")
      ->check(CLI::Range(1, 200).description(""))
      ->type_name("N")
      ->capture_default_str();
  command->add_option("--out", arguments->out, "The page (-: standard output)")
      ->type_name("FILE.html")
      ->capture_default_str();
  command->callback([arguments, &run] { run = [arguments] { return MakeReport(*arguments); }; });
  return command;
}

}  // namespace bendloop::host
