// SPDX-License-Identifier: Apache-2.0
// The daemon's path under load: a table of losses, queue, CPU, memory and latencies.
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <fstream>
#include <iostream>
#include <string>
#include <thread>
#include <vector>

#include "tests/bench/bench_table.h"
#include "tests/bench/load/load_plot.h"
#include "tests/bench/load/load_run.h"

namespace bendloop::bench {
namespace {

struct Options {
  std::vector<double> rates = {300, 600, 1200};
  double seconds = 60;
  std::uint64_t parts = 30;
  double part_seconds = 3;
  std::uint64_t soak = 0;
  bool stress = false;
  bool quick = false;
  bool no_record = false;
  std::string directory;
  std::string json_path;
  std::string plot_path;
};

constexpr const char* kFooter = R"(
Examples:
  bendloop_load --stress                   all rates, 60 s and 30 parts each, beside stress-ng
  bendloop_load --quick                    shows in half a minute that it works
  bendloop_load --rates 600 --soak 1000    flat memory: 1000 short scans
  bendloop_load --stress --json load.json --plot load.svg)";

// stress-ng on every CPU, ended with this object.
class Hog {
 public:
  explicit Hog(bool wanted) {
    if (!wanted) return;
    child_ = fork();
    if (child_ != 0) return;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    const std::string count = std::to_string(std::max(1u, std::thread::hardware_concurrency()));
    execlp("stress-ng", "stress-ng", "--quiet", "--cpu", count.c_str(), nullptr);
    _exit(127);
  }
  ~Hog() {
    if (child_ <= 0) return;
    kill(child_, SIGTERM);
    waitpid(child_, nullptr, 0);
  }
  Hog(const Hog&) = delete;
  Hog& operator=(const Hog&) = delete;
  bool runs() const { return child_ > 0 && waitpid(child_, nullptr, WNOHANG) == 0; }

 private:
  pid_t child_ = -1;
};

double At(std::vector<double> values, double part) {
  if (values.empty()) return 0;
  const auto k = static_cast<std::size_t>(part * static_cast<double>(values.size() - 1) + 0.5);
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(k), values.end());
  return values[k];
}

void AddLatency(std::vector<Row>& rows, const std::string& what, const std::vector<double>& ms,
                std::optional<double> bar, std::optional<double> goal) {
  if (ms.empty()) return;  // no value is no good value
  rows.push_back({what + ", p50", At(ms, 0.5), "ms"});
  rows.push_back({what + ", p99", At(ms, 0.99), "ms", bar, goal});
  rows.back().note = std::to_string(ms.size()) + " values";
  rows.push_back({what + ", max", At(ms, 1.0), "ms"});
}

std::vector<Row> RowsOf(const LoadCase& load, const LoadResult& r) {
  std::vector<Row> rows;
  rows.push_back({"points a second", load.profiles_per_second * 2000, "", 1.2e6, 2.4e6});
  rows.back().more_is_better = true;
  rows.back().note = std::to_string(r.profiles) + " profiles in " + std::to_string(r.parts) +
                     " parts of " + Number(load.seconds) + " s";
  rows.push_back({"profiles lost", static_cast<double>(r.dropped), "", 0, 0});
  rows.push_back({"left out of the recording", static_cast<double>(r.recorder_dropped), "", 0, 0});
  rows.push_back({"parts corrected", static_cast<double>(r.corrected), ""});
  rows.back().note = std::to_string(r.refused) + " not, " + std::to_string(r.failed) +
                     " not measured" + (r.first_reason.empty() ? "" : ": " + r.first_reason);
  rows.push_back({"queue, p99", At(r.queue, 0.99), "profiles"});
  rows.push_back({"queue, most", static_cast<double>(r.queue_peak), "profiles"});
  rows.back().note = "of " + std::to_string(r.queue_capacity);
  rows.push_back({"processor", r.cpu_percent, "% of one"});
  rows.push_back({"peak memory", r.peak_mb, "MB", 256, 128});
  rows.push_back({"lateness, most", r.lateness_peak_ms, "ms"});
  rows.back().note = r.realtime_note;
  AddLatency(rows, "profile to live LRA", r.live_ms, {}, {});
  AddLatency(rows, "last profile to LRA", r.lra_ms, 100, 20);
  for (const auto& [stage, ms] : r.stage_ms) {
    rows.push_back({"- " + stage + ", p50", At(ms, 0.5), "ms"});
  }
  AddLatency(rows, "last profile to committed", r.committed_ms, 250, 50);
  if (r.parts >= 20) {
    const auto mean = [](const std::vector<double>& v, std::size_t from, std::size_t to) {
      double sum = 0;
      for (std::size_t i = from; i < to; ++i) sum += v[i];
      return sum / static_cast<double>(to - from);
    };
    const std::size_t n = r.memory_mb.size();
    rows.push_back({"memory, last tenth less second tenth",
                    mean(r.memory_mb, n - n / 10, n) - mean(r.memory_mb, n / 10, 2 * (n / 10)),
                    "MB"});
    rows.push_back(
        {"angle error, second tenth", mean(r.angle_error_deg, n / 10, 2 * (n / 10)), "degree"});
    rows.push_back({"angle error, last tenth", mean(r.angle_error_deg, n - n / 10, n), "degree"});
  }
  return rows;
}

std::vector<LoadCase> CasesOf(const Options& options) {
  std::vector<LoadCase> cases;
  for (const double rate : options.rates) {
    const std::string per_second = Number(rate) + " profiles/s";
    if (options.soak > 0) {
      cases.push_back({per_second + ", soak", rate, options.part_seconds, options.soak});
      continue;
    }
    cases.push_back({per_second + ", one long scan", rate, options.seconds, 1});
    cases.push_back({per_second + ", part after part", rate, options.part_seconds, options.parts});
  }
  for (LoadCase& load : cases) load.record = !options.no_record;
  return cases;
}

int Run(const Options& options) {
  const Hog hog(options.stress);
  std::this_thread::sleep_for(std::chrono::milliseconds(options.stress ? 500 : 0));
  if (options.stress && !hog.runs()) {
    std::cerr << "bendloop_load: stress-ng does not run: apt install stress-ng, or leave --stress "
                 "out\n";
    return 2;
  }
  std::string scratch = options.directory;
  if (scratch.empty()) {
    scratch = (std::filesystem::temp_directory_path() / "bendloop-load-XXXXXX").string();
    if (mkdtemp(scratch.data()) == nullptr) return 4;
  }
  std::ifstream loadavg("/proc/loadavg");
  std::string line;
  std::getline(loadavg, line);
  std::cout << std::thread::hardware_concurrency() << " CPUs; load when started: " << line
            << (options.stress ? "; beside stress-ng on every CPU" : "") << "\n\n";
  nlohmann::json all = nlohmann::json::array();
  std::vector<PlotSeries> plots;
  int code = 0;
  for (const LoadCase& load : CasesOf(options)) {
    const auto directory = std::filesystem::path(scratch) / "run";
    const LoadResult result = RunLoadApart(load, directory);
    std::filesystem::remove_all(directory);
    if (!result.problem.empty()) {
      std::cerr << "bendloop_load: " << load.name << ": " << result.problem << "\n";
      code = 4;
      if (result.parts == 0) continue;
    }
    const auto rows = RowsOf(load, result);
    PrintTable(std::cout, load.name, rows);
    std::cout << std::flush;
    plots.push_back({load.name, result});
    all.push_back({{"case", load.name},
                   {"stress", options.stress},
                   {"rows", ToJson(rows)},
                   {"raw", nlohmann::json(result)}});
  }
  if (options.directory.empty()) std::filesystem::remove_all(scratch);
  if (!options.json_path.empty()) std::ofstream(options.json_path) << all.dump(1) << '\n';
  if (!options.plot_path.empty()) std::ofstream(options.plot_path) << PlotSvg(plots);
  return code;
}

}  // namespace
}  // namespace bendloop::bench

int main(int argc, char** argv) {
  bendloop::bench::Options options;
  CLI::App app{"bendloop_load: the daemon's path under load, from profile to bender"};
  app.footer(bendloop::bench::kFooter);
  app.add_option("--rates", options.rates, "Profiles a second, each of 2000 points")
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--seconds", options.seconds, "Of the long scan")->capture_default_str();
  app.add_option("--parts", options.parts, "Short scans")->capture_default_str();
  app.add_option("--part-seconds", options.part_seconds, "Of a short scan")->capture_default_str();
  app.add_option("--soak", options.soak, "Only so many short scans: memory and drift")
      ->type_name("PARTS");
  app.add_flag("--stress", options.stress, "Beside stress-ng on every CPU");
  app.add_flag("--quick", options.quick, "5 s and 5 parts at 600 profiles/s");
  app.add_flag("--no-record", options.no_record, "Without recorder, to see what it costs");
  app.add_option("--dir", options.directory, "Where sessions and state go (default: a new one)");
  app.add_option("--json", options.json_path, "Figures and every single value")->type_name("FILE");
  app.add_option("--plot", options.plot_path, "Latencies, queue and memory as a picture")
      ->type_name("FILE.svg");
  CLI11_PARSE(app, argc, argv);
  if (options.quick) {
    options.rates = {600};
    options.seconds = 5;
    options.parts = 5;
  }
  return bendloop::bench::Run(options);
}
