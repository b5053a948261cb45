// SPDX-License-Identifier: Apache-2.0
// Times and errors of the reconstruction as a whole, beside their targets and beside other
// libraries: Markdown tables and pictures.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <string>
#include <thread>
#include <vector>

#include "tests/bench/bench_cases.h"
#include "tests/bench/bench_noise.h"
#include "tests/bench/bench_plot.h"
#include "tests/bench/bench_table.h"
#include "tests/bench/bench_times.h"
#include "tests/bench/bench_tubes.h"

namespace bendloop::bench {
namespace {

struct Options {
  bool quick = false;
  bool only_tubes = false;
  bool only_times = false;
  bool only_noise = false;
  bool no_rivals = false;
  std::uint64_t sets = 1;
  std::size_t threads = 1;
  std::string json_path;
  std::string plot_directory;
};

constexpr const char* kFooter = R"(
Examples:
  bendloop_bench --plots tests/bench          everything, tables and pictures: some minutes
  bendloop_bench --quick                      shows in half a minute that it works
  bendloop_bench --only-times --no-rivals     how fast
  bendloop_bench --only-times --threads 2     the same on two processors: see the wall times
  bendloop_bench --only-tubes --sets 10       how exact, on 300 tubes
  bendloop_bench --only-noise --json noise.json)";

std::string FirstLine(const char* path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  return line.empty() ? "unknown" : line;
}

std::string Processor() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    if (line.rfind("model name", 0) == 0) return line.substr(line.find(':') + 2);
  }
  return "unknown";
}

bool Write(const std::filesystem::path& path, const std::string& text) {
  std::ofstream file(path);
  file << text;
  if (file.flush()) return true;
  std::cerr << "bendloop_bench: cannot write " << path.string() << '\n';
  return false;
}

// The paper's case first.
std::vector<SizedTimes> RunTimes(const Options& options, nlohmann::json& json) {
  std::vector<SizedTimes> times;
  times.push_back(
      TimeAll(PaperCase(6005, 1), options.quick ? 3 : 25, !options.no_rivals, options.threads));
  const auto paper = PaperRows(times.front());
  PrintTable(std::cout, "Paper's case: 6005 points, one view, noise 0.05 mm", paper);
  json["paper"] = ToJson(paper);
  const std::vector<std::size_t> sizes =
      options.quick ? std::vector<std::size_t>{20'000, 50'000}
                    : std::vector<std::size_t>{30'000, 100'000, 300'000, 1'000'000};
  for (const std::size_t size : sizes) {
    times.push_back(
        TimeAll(PaperCase(size, 2), options.quick ? 1 : 5, !options.no_rivals, options.threads));
  }
  const auto growth = GrowthRows({times.begin() + 1, times.end()});
  PrintTable(std::cout, "The same tube, more points", growth);
  json["growth"] = ToJson(growth);
  PrintSideBySide(std::cout, times);
  json["side_by_side"] = ToJson(times);
  std::cout << std::flush;
  return times;
}

void RunTubes(const Options& options, nlohmann::json& json) {
  TubeResults results;
  for (std::uint64_t set = 0; set < options.sets; ++set) {
    for (int i = 0; i < kTubes; i += options.quick ? 5 : 1) {
      RunTube(SectionEightCase(i, set), results);
    }
  }
  const auto tubes = TubeRows(results);
  PrintTable(std::cout, std::to_string(results.tubes) + " tubes as in section 8 of the paper",
             tubes);
  for (const std::string& wrong : results.wrong) std::cout << "- " << wrong << '\n';
  std::cout << (results.wrong.empty() ? "" : "\n") << std::flush;
  json["tubes"] = ToJson(tubes);
  json["tube_list"] = results.list;
}

int Run(const Options& options) {
  const std::string load = FirstLine("/proc/loadavg");
  std::cout << "Processor: " << Processor() << ", " << std::thread::hardware_concurrency()
            << " cores; load when started: " << load << "\n\n";
  nlohmann::json json = {{"processor", Processor()},
                         {"cores", std::thread::hardware_concurrency()},
                         {"load", load},
                         {"quick", options.quick}};
  bool written = true;
  const auto plot = [&](const char* name, const std::string& svg) {
    if (options.plot_directory.empty()) return;
    written = Write(std::filesystem::path(options.plot_directory) / name, svg) && written;
  };
  if (!options.only_tubes && !options.only_noise) {
    plot("time_over_points.svg", TimeSvg(RunTimes(options, json)));
  }
  if (!options.only_times && !options.only_noise) RunTubes(options, json);
  if (!options.only_times && !options.only_tubes) {
    const NoiseSweep sweep = SweepNoise(options.quick ? 5 : 1, options.sets);
    PrintNoise(std::cout, sweep);
    json["noise"] = ToJson(sweep);
    plot("error_over_noise.svg", NoiseSvg(sweep));
  }
  if (!options.json_path.empty())
    written = Write(options.json_path, json.dump(2) + '\n') && written;
  return written ? 0 : 1;
}

}  // namespace
}  // namespace bendloop::bench

int main(int argc, char** argv) {
  bendloop::bench::Options options;
  CLI::App app{
      "Times and errors of the reconstruction beside their targets: Markdown and pictures."};
  app.footer(bendloop::bench::kFooter);
  app.add_flag("--quick", options.quick, "Few runs and tubes: shows that it works, not how fast");
  auto* tubes = app.add_flag("--only-tubes", options.only_tubes, "Only the 30 tubes");
  auto* times = app.add_flag("--only-times", options.only_times, "Only the times");
  auto* noise = app.add_flag("--only-noise", options.only_noise, "Only the errors over noise");
  tubes->excludes(times)->excludes(noise);
  times->excludes(noise);
  app.add_flag("--no-rivals", options.no_rivals, "Leave out the other libraries");
  app.add_option("--sets", options.sets, "Sets of 30 tubes; the first is the published one")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--threads", options.threads, "Threads of bendloop where its time is measured")
      ->capture_default_str()
      ->check(CLI::Range(1, 256));
  app.add_option("--json", options.json_path, "Write everything to this file as well");
  app.add_option("--plots", options.plot_directory,
                 "Draw time_over_points.svg and error_over_noise.svg there")
      ->type_name("DIR")
      ->check(CLI::ExistingDirectory);
  CLI11_PARSE(app, argc, argv);
  return bendloop::bench::Run(options);
}
