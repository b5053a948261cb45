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

#include "tests/bench/load/load_plot.h"
#include "tests/bench/load/load_report.h"
#include "tests/bench/load/load_run.h"
#include "tests/bench/load/load_soak.h"

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
For each run: a table beside the targets, histograms with p50, p99 and max, for a soak the drift of
memory, latencies and each L, R, A over the parts; at the end all runs side by side.

Examples:
  bendloop_load --quick                     shows in half a minute that it works
  bendloop_load --stress --parts 20 --plot load.svg
                                            300, 600 and 1200 profiles/s for 60 s and 20 parts each,
                                            beside stress-ng on every CPU: 7 minutes
  bendloop_load --rates 1200 --part-seconds 0.8 --soak 1000 --plot soak.svg
                                            1000 short scans, memory and drift: 20 minutes
Exit codes: 0 done; 2 wrong usage; 4 a run failed or a file could not be written)";

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

bool Write(const std::string& path, const std::string& text) {
  std::ofstream file(path);
  file << text;
  if (file.flush()) return true;
  std::cerr << "bendloop_load: cannot write " << path << '\n';
  return false;
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
  std::vector<LoadReport> reports;
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
    const auto rows = LoadRows(load, result);
    PrintTable(std::cout, load.name, rows);
    PrintHistograms(std::cout, result);
    const auto drifts = Drifts(result);
    if (options.soak > 0) PrintDrifts(std::cout, result, drifts);
    std::cout << std::flush;
    all.push_back({{"case", load.name},
                   {"stress", options.stress},
                   {"rows", ToJson(rows)},
                   {"drift", ToJson(drifts)},
                   {"raw", nlohmann::json(result)}});
    reports.push_back({load, result});
  }
  if (options.directory.empty()) std::filesystem::remove_all(scratch);
  if (reports.size() > 1) PrintSideBySide(std::cout, reports);
  if (!options.json_path.empty() && !Write(options.json_path, all.dump(1) + '\n')) code = 4;
  if (!options.plot_path.empty() && !reports.empty() &&
      !Write(options.plot_path, options.soak > 0 ? SoakSvg(reports.front()) : LoadSvg(reports))) {
    code = 4;
  }
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
  app.add_option("--plot", options.plot_path,
                 "A picture of it: latencies, queue and memory; of a soak the first rate's drift")
      ->type_name("FILE.svg");
  CLI11_PARSE(app, argc, argv);
  if (options.quick) {
    options.rates = {600};
    options.seconds = 5;
    options.parts = 5;
  }
  return bendloop::bench::Run(options);
}
