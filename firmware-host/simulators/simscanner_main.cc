// SPDX-License-Identifier: Apache-2.0
#include <poll.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <iostream>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "drivers/simulated_scanner/simulate_session.h"
#include "drivers/simulated_scanner/simulated_scanner.h"
#include "firmware-host/simulators/scan_operator.h"
#include "firmware-host/simulators/scan_options.h"
#include "firmware-host/simulators/simulator_main.h"
#include "firmware-host/simulators/tray_file.h"

namespace bendloop::host {
namespace {

using drivers::ScanPace;
using drivers::SimulatedScanner;
using drivers::VirtualScan;
using drivers::VirtualScanOptions;
using hal::ErrorKind;
using hal::Fail;
using hal::Result;

constexpr std::int64_t kBetweenScansNs = 1'000'000'000;

// The simulated scanner and who stands beside it.
class Operator {
 public:
  Operator(SimulatedScanner& scanner, VirtualScanOptions options, ScanPace pace, bool lay_on_table)
      : scanner_(scanner), options_(std::move(options)), pace_(pace), lay_on_table_(lay_on_table) {}

  // One command line; false: switch off.
  bool Obey(const std::string& line) {
    std::istringstream words(line);
    std::string verb;
    words >> verb;
    if (verb.empty()) return true;
    if (verb == "quit") return false;
    if (verb == "scan") {
      std::string file;
      std::getline(words >> std::ws, file);
      if (auto begun = Scan(file); !begun) {
        std::cout << "error " << begun.error().message << std::endl;
      }
    } else if (verb == "misbehave") {
      Misbehave(words);
    } else if (line == "go on") {
      scanner_.device().GoOn();
      std::cout << "ok" << std::endl;
    } else {
      std::cout << "error \"" << verb << "\": expected scan FILE, misbehave FAULT, go on or quit"
                << std::endl;
    }
    return true;
  }

  void Report() {
    tally_.Report(
        scanner_.scans_finished(), scanner_.scans_abandoned(),
        [](const char* what, const std::string& name) { std::cout << what << name << std::endl; });
  }

 private:
  Result<void> Scan(const std::string& file) {
    auto part = ReadTray(file);
    if (!part) return Fail(part.error());
    VirtualScanOptions options = options_;
    options.seed = options_.seed * 1'000'003 + part->serial;  // no two parts alike
    options.start_t_ns = next_t_ns_;
    if (auto checked = drivers::CheckScan(part->tube, options); !checked) {
      return Fail(checked.error().kind, file + ": " + checked.error().message);
    }
    if (lay_on_table_) part->tube = drivers::LayOnTable(part->tube, options.seed);
    auto scan = std::make_shared<const VirtualScan>(part->tube, options);
    next_t_ns_ = scan->EndEvent().t_ns + kBetweenScansNs;
    const std::string name = std::filesystem::path(file).filename().string();
    tally_.Begin(name);
    std::cout << "scanning " << name << " " << scan->profile_count() << " profiles" << std::endl;
    scanner_.Trigger(std::move(scan), pace_);
    return {};
  }

  void Misbehave(std::istringstream& words) {
    std::string fault;
    std::getline(words, fault);
    const auto parsed = drivers::ParseScannerFault(fault, false);
    if (!parsed) {
      std::cout << "error " << parsed.error().message << std::endl;
      return;
    }
    scanner_.Misbehave(*parsed);
    std::cout << "ok" << std::endl;
  }

  SimulatedScanner& scanner_;
  VirtualScanOptions options_;
  ScanPace pace_;
  bool lay_on_table_;
  std::int64_t next_t_ns_ = kBetweenScansNs;
  ScanTally tally_;
};

// Serves the host and obeys standard input until it ends or says quit.
Result<void> Serve(SimulatedScanner& scanner, Operator& person) {
  scanner.WakeOn(STDIN_FILENO);
  CommandLines lines;
  while (true) {
    if (auto served = scanner.Poll(std::chrono::seconds(1)); !served) {
      return Fail(served.error());
    }
    person.Report();
    pollfd waiting{STDIN_FILENO, POLLIN, 0};
    if (poll(&waiting, 1, 0) <= 0) continue;
    const auto obey = [&person](const std::string& line) { return person.Obey(line); };
    if (lines.Read(obey) != CommandLines::State::kMore) return {};
  }
}

struct Options {
  VirtualScanOptions scan;
  std::uint16_t port = 0;
  int views = 1;
  bool all_around = false;
  std::string pace = "real";
  std::string pose = "table";
  std::vector<std::string> clutter;
  int clamps = 2;

  bool has(const char* what) const {
    return std::find(clutter.begin(), clutter.end(), what) != clutter.end();
  }
};

void Describe(CLI::App& app) {
  app.description(
      "An arm scanner that is not there: serves the scanner's wire protocol on a TCP port and "
      "scans "
      "the tubes that it is given. Prints \"listening PORT\", then obeys one command a line on "
      "standard input:\n"
      "  scan FILE            scan the part in this tray file (schema bendloop.tray/1) as soon as "
      "a "
      "host has started the scanner; prints \"scanning NAME N profiles\" and at its end \"scanned "
      "NAME\", or \"abandoned NAME\" if the host went away\n"
      "  misbehave FAULT [after N]  before the next profile, or N later; once (below)\n"
      "  go on                end a stall, or being mute, before its time\n"
      "  quit                 or the end of input: switch off");
  app.footer("Faults:\n" + drivers::ScannerFaultHelp(false) +
             "Example:\n"
             "  (echo scan tray/part-0001.json; cat) |\n"
             "    bendloop-simscanner --views 2 --clutter table");
}

void AddOptions(CLI::App& app, Options& options) {
  app.add_option("--port", options.port, "TCP port on 127.0.0.1; 0 picks a free one")
      ->capture_default_str();
  app.add_option("--seed", options.scan.seed, "Of pose, noise and fliers")->capture_default_str();
  AddScanOptions(app, options.scan);
  app.add_option("--views", options.views, "Passes along the tube")
      ->check(CLI::Range(1, 36))
      ->capture_default_str();
  app.add_flag("--all-around", options.all_around,
               "Spread the views over the whole turn, not the upside");
  app.add_option("--rate", options.scan.profiles_per_second, "Profiles per second")
      ->check(Within(drivers::kProfilesPerSecond))
      ->capture_default_str();
  app.add_option("--pace", options.pace, "real: at the rate; max: as fast as the host takes them")
      ->check(CLI::IsMember({"real", "max"}))
      ->capture_default_str();
  AddClutterOption(app, options.clutter);
  app.add_option("--clamps", options.clamps, "How many, if they are in view")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  app.add_option("--pose", options.pose,
                 "table: a seeded pose on the table; origin: begins at the origin")
      ->check(CLI::IsMember({"table", "origin"}))
      ->capture_default_str();
  app.add_flag("--reverse", options.scan.path.reverse, "Begin at the tube's end");
}

Result<void> Run(CLI::App& app, int argc, char** argv) {
  Options options;
  Describe(app);
  AddOptions(app, options);
  app.parse(argc, argv);
  VirtualScanOptions& scan = options.scan;
  scan.path.views_deg = drivers::SpreadViewsDeg(options.views, options.all_around);
  scan.clutter.table = options.has(kClutterTable);
  scan.clutter.clamps = options.has(kClutterClamps) ? options.clamps : 0;
  scan.clutter.second_tube = options.has(kClutterSecondTube);
  drivers::WireIdentity identity{"bendloop simulated arm scanner", "SIM-0001", "1.0", "none", 0};
  identity.max_points = static_cast<std::uint32_t>(scan.rays);
  hal::SteadyClock clock;
  auto scanner = SimulatedScanner::Listen(options.port, identity, clock);
  if (!scanner) return Fail(scanner.error());
  std::cout << "listening " << (*scanner)->port() << std::endl;
  Operator person(**scanner, scan, options.pace == "max" ? ScanPace::kMax : ScanPace::kRealTime,
                  options.pose == "table");
  return Serve(**scanner, person);
}

}  // namespace
}  // namespace bendloop::host

int main(int argc, char** argv) {
  return bendloop::host::SimulatorMain("bendloop-simscanner", bendloop::host::Run, argc, argv);
}
