// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cli/demo/demo.h"

#include <signal.h>
#include <unistd.h>

#include <cmath>
#include <csignal>
#include <cstdio>
#include <iostream>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "config/load.h"
#include "drivers/simulated_scanner/simulate_session.h"
#include "firmware-host/cell/part_plan.h"
#include "firmware-host/cli/demo/child_process.h"
#include "firmware-host/cli/demo/demo_files.h"
#include "firmware-host/console/message.h"
#include "firmware-host/console/terminal.h"
#include "firmware-host/console/whole_file.h"
#include "firmware-host/daemon/status_client.h"
#include "firmware-host/result/program_json.h"
#include "firmware-host/result/result_json.h"
#include "firmware-host/simulators/tray_file.h"
#include "firmware-host/text/progress.h"
#include "firmware-host/text/result_text.h"
#include "firmware-host/text/style.h"
#include "firmware-host/text/table.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using namespace std::chrono_literals;

constexpr auto kStartTimeout = 30s;
constexpr auto kBendTimeout = 30s;
constexpr auto kPartTimeout = 180s;
constexpr auto kPollPeriod = 50ms;
constexpr auto kFarewell = 10s;  // of the daemon, when the demo is interrupted

volatile std::sig_atomic_t g_signal = 0;

extern "C" void OnSignal(int signal) { g_signal = signal; }

// Ctrl-C ends the demo in good order: the processes close what they have open.
class CatchInterrupts {
 public:
  CatchInterrupts() {
    struct sigaction action {};
    action.sa_handler = OnSignal;
    sigaction(SIGINT, &action, nullptr);
    sigaction(SIGTERM, &action, nullptr);
  }
  CatchInterrupts(const CatchInterrupts&) = delete;
  CatchInterrupts& operator=(const CatchInterrupts&) = delete;
  // Ends the process as the signal would have; the shell knows then that it was interrupted.
  ~CatchInterrupts() {
    signal(SIGINT, SIG_DFL);
    signal(SIGTERM, SIG_DFL);
    if (g_signal == 0) return;
    TellPerson("bendloop", "interrupted; the demo's processes have ended");
    raise(g_signal);
  }
};

tl::unexpected<hal::Error> Interrupted() {
  return hal::Fail(hal::ErrorKind::kDevice, "the demo was interrupted");
}

// What the press really does: more springback and stretch than the part file says, and scatter.
const std::vector<std::string> kPhysics = {"--springback-20",    "1.9",  "--springback-120", "5.2",
                                           "--elongation",       "2.6",  "--twist",          "0.4",
                                           "--scatter-angle",    "0.03", "--scatter-length", "0.03",
                                           "--scatter-rotation", "0.03"};

// Posts hold the tube above a table, which is in view, and clamps hide it in two places.
constexpr int kTableGapMm = 30;
constexpr int kClamps = 2;
constexpr const char* kUsbSerial = "DEMO";

// Worst deviation of a part on each axis.
struct Worst {
  double length_mm = 0;
  double rotation_deg = 0;
  double angle_deg = 0;
  double of_tolerance = 0;  // the largest of all, 1 is the limit
};

void Take(const pipeline::Deviation& deviation, double& worst, double& of_tolerance) {
  if (!std::isfinite(deviation.deviation)) return;
  if (deviation.state == pipeline::ToleranceState::kNotJudged) return;
  worst = std::max(worst, std::abs(deviation.deviation));
  if (deviation.tolerance && *deviation.tolerance > 0) {
    of_tolerance = std::max(of_tolerance, std::abs(deviation.deviation) / *deviation.tolerance);
  }
}

Worst WorstOf(const RunResult& result) {
  Worst worst;
  if (!result.inspection) return worst;
  for (const pipeline::RowInspection& row : result.inspection->rows) {
    Take(row.length_mm, worst.length_mm, worst.of_tolerance);
    Take(row.rotation_deg, worst.rotation_deg, worst.of_tolerance);
    Take(row.angle_deg, worst.angle_deg, worst.of_tolerance);
  }
  return worst;
}

std::string NameOf(std::uint32_t part) {
  char name[32];
  std::snprintf(name, sizeof name, "part-%04u", part);
  return name;
}

fs::path BinDirectory() { return fs::read_symlink("/proc/self/exe").parent_path(); }

class Demo {
 public:
  Demo(DemoOptions options, config::CellConfig cell, double nominal_length_mm)
      : options_(std::move(options)),
        cell_(std::move(cell)),
        nominal_length_mm_(nominal_length_mm),
        progress_(std::cout, isatty(STDOUT_FILENO) != 0, TerminalColumns(STDOUT_FILENO)) {}

  hal::Result<void> Run();

 private:
  hal::Result<void> RunParts();
  hal::Result<void> Launch(std::optional<ChildProcess>& child, const std::string& program,
                           const std::vector<std::string>& arguments);
  hal::Result<void> StartProcesses();
  hal::Result<std::string> StartScanner();
  hal::Result<fs::path> ScanOf(const fs::path& tray);
  int Views() const { return options_.quick ? 2 : 3; }
  int Rate() const { return options_.quick ? 4000 : 800; }
  hal::Result<void> AwaitDaemon();
  hal::Result<void> AwaitCount(std::uint32_t part);
  hal::Result<RunResult> MakePart(std::uint32_t part);
  hal::Result<void> AwaitResult(const fs::path& file);
  void ShowProgress();
  std::string Problem() const;
  hal::Result<void> Conclude();
  fs::path Log(const char* name) const { return options_.out / "logs" / name; }

  const DemoOptions options_;
  const config::CellConfig cell_;
  const double nominal_length_mm_;
  Progress progress_;
  std::optional<ChildProcess> bender_;
  std::optional<ChildProcess> scanner_;
  std::optional<ChildProcess> daemon_;
  std::vector<RunResult> results_;
};

hal::Result<void> Demo::Launch(std::optional<ChildProcess>& child, const std::string& program,
                               const std::vector<std::string>& arguments) {
  auto started = ChildProcess::Start(BinDirectory() / program, arguments,
                                     options_.out / "logs" / (program + ".log"));
  if (!started) return hal::Fail(started.error());
  child.emplace(std::move(*started));
  return {};
}

hal::Result<void> Demo::StartProcesses() {
  const std::string radius = std::to_string(cell_.part.pipe_radius_mm);
  const bool canopen = options_.link == DemoLink::kCanopen;
  const char* map = canopen ? "canopen-map.toml" : "register-map.toml";
  std::vector<std::string> bender = {
      "--map",         (options_.out / map).string(),
      "--program",     (options_.out / "first-program.json").string(),
      "--part-number", std::to_string(cell_.part.part_number),
      "--pipe-radius", radius,
      "--tray",        (options_.out / "tray").string(),
      "--seed",        std::to_string(options_.seed)};
  bender.insert(bender.end(), kPhysics.begin(), kPhysics.end());
  if (canopen) {
    bender.insert(bender.end(),
                  {"--canopen", options_.can_interface, "--node", std::to_string(kDemoNodeId),
                   "--object-dictionary", (options_.out / "bender.eds").string()});
  } else if (options_.link == DemoLink::kCanIsotp) {
    bender.insert(bender.end(), {"--can", options_.can_interface});
  }
  if (auto started = Launch(bender_, "bendloop-simbender", bender); !started) return started;
  const auto bender_place = bender_->Expect("listening", kStartTimeout);
  if (!bender_place) return hal::Fail(bender_place.error());

  auto scanner = StartScanner();
  if (!scanner) return hal::Fail(scanner.error());

  std::vector<std::string> daemon = {"--config",  LiveCellFile(options_).string(),
                                     "--scanner", *scanner,
                                     "--parts",   std::to_string(options_.parts)};
  std::string reached = *bender_place;
  if (options_.link == DemoLink::kTcp) {
    reached = "127.0.0.1:" + *bender_place;
    daemon.insert(daemon.end(), {"--bender", reached});
  }
  if (auto started = Launch(daemon_, "bendloopd", daemon); !started) return started;
  std::cout << "bender   "
            << (canopen                           ? "CANopen, "
                : options_.link == DemoLink::kTcp ? "Modbus TCP, "
                                                  : "Modbus by ISO-TP, ")
            << reached << "\n"
            << "scanner  laser profiles, " << *scanner << "\n";
  return AwaitDaemon();
}

// Where the daemon finds it.
hal::Result<std::string> Demo::StartScanner() {
  if (options_.scanner == DemoScanner::kUsb) {
    const std::vector<std::string> scanner = {"--serial", kUsbSerial, "--pace",
                                              options_.quick ? "max" : "real"};
    if (auto started = Launch(scanner_, "bendloop-usbscanner", scanner); !started) {
      return hal::Fail(started.error());
    }
    if (auto there = scanner_->Expect("listening", kStartTimeout); !there) {
      return hal::Fail(there.error());
    }
    return std::string("usb:") + kUsbSerial;
  }
  const std::vector<std::string> scanner = {"--seed",      std::to_string(options_.seed),
                                            "--clutter",   "table,clamps",
                                            "--clamps",    std::to_string(kClamps),
                                            "--table-gap", std::to_string(kTableGapMm),
                                            "--spacing",   std::to_string(options_.spacing_mm),
                                            "--rays",      std::to_string(options_.rays),
                                            "--views",     std::to_string(Views()),
                                            "--rate",      std::to_string(Rate())};
  if (auto started = Launch(scanner_, "bendloop-simscanner", scanner); !started) {
    return hal::Fail(started.error());
  }
  const auto port = scanner_->Expect("listening", kStartTimeout);
  if (!port) return hal::Fail(port.error());
  return "127.0.0.1:" + *port;
}

// The file that the scanner is given for a part: the part itself for the simulated scanner; for the
// one on USB, which plays recordings, what the simulated one would see of it.
hal::Result<fs::path> Demo::ScanOf(const fs::path& tray) {
  if (options_.scanner == DemoScanner::kTcp) return fs::absolute(tray);
  const auto part = ReadTray(tray.string());
  if (!part) return hal::Fail(part.error());
  drivers::SimulateSessionOptions recording;
  recording.scan.seed = options_.seed * 1'000'003 + part->serial;
  recording.scan.clutter.table = true;
  recording.scan.clutter.clamps = kClamps;
  recording.scan.clutter.table_gap_mm = kTableGapMm;
  recording.scan.path.profile_spacing_mm = options_.spacing_mm;
  recording.scan.path.views_deg = drivers::SpreadViewsDeg(Views(), false);
  recording.scan.rays = options_.rays;
  recording.scan.profiles_per_second = Rate();
  const fs::path session =
      fs::absolute(options_.out / "scans" / (tray.stem().string() + ".session"));
  if (auto made = drivers::SimulateSession(part->tube, recording, session.string()); !made) {
    return hal::Fail(made.error());
  }
  return session;
}

hal::Result<void> Demo::AwaitDaemon() {
  const auto deadline = Clock::now() + kStartTimeout;
  while (Clock::now() < deadline) {
    if (const auto code = daemon_->Exited()) {
      return hal::Fail(hal::ErrorKind::kDevice, "bendloopd ended with exit code " +
                                                    std::to_string(*code) + daemon_->LastWords());
    }
    const auto status = FetchStatus(options_.out / "status.json");
    if (g_signal != 0) return Interrupted();
    if (status && status->value("state", "") == "waiting for a scan") {
      std::cout << "daemon   bendloopd, ready\n" << std::flush;
      return {};
    }
    std::this_thread::sleep_for(kPollPeriod);
  }
  return hal::Fail(hal::ErrorKind::kDevice,
                   "bendloopd was not ready in time; see " + Log("bendloopd.log").string());
}

void Demo::ShowProgress() {
  const auto status = FetchStatus(options_.out / "status.json");
  if (!status || !status->contains("scan")) return;
  const Json& scan = status->at("scan");
  std::optional<hal::Error> error;
  const JsonReader reader(scan, "status", error);
  pipeline::LiveView view;
  view.profiles = reader.At("profiles").Count();
  view.points = reader.At("points").Count();
  view.covered_mm = reader.At("covered_mm").Number();
  view.pipe_radius_mm = reader.At("pipe_radius_mm").Number();
  view.program = ReadRows(reader.At("rows"));
  view.sigma = ReadRows(reader.At("sigma_rows"));
  if (!error) progress_.Show(view, nominal_length_mm_);
}

// What keeps the daemon from keeping what the demo waits for, a full disk above all.
std::string Demo::Problem() const {
  const auto status = FetchStatus(options_.out / "status.json");
  if (!status) return "";
  const std::string problem = status->value("problem", "");
  if (!problem.empty()) return problem;
  return status->value(Json::json_pointer("/health/recorder_error"), std::string());
}

hal::Result<void> Demo::AwaitResult(const fs::path& file) {
  const auto deadline = Clock::now() + kPartTimeout;
  std::error_code error;
  while (Clock::now() < deadline) {
    if (fs::exists(file, error)) return {};
    if (g_signal != 0) return Interrupted();
    if (daemon_->Exited() && !fs::exists(file, error)) {
      return hal::Fail(hal::ErrorKind::kDevice, "bendloopd ended without a result for " +
                                                    file.stem().string() + daemon_->LastWords());
    }
    if (const std::string problem = Problem(); !problem.empty()) {
      return hal::Fail(hal::ErrorKind::kDevice, "bendloopd: " + problem);
    }
    ShowProgress();
    std::this_thread::sleep_for(kPollPeriod);
  }
  return hal::Fail(hal::ErrorKind::kDevice, "no result for " + file.stem().string() + "; see " +
                                                Log("bendloopd.log").string());
}

// Nobody carries a tube to the scanner faster than the daemon looks at the bender, but a demo does.
hal::Result<void> Demo::AwaitCount(std::uint32_t part) {
  const auto deadline = Clock::now() + kBendTimeout;
  while (Clock::now() < deadline) {
    if (g_signal != 0) return Interrupted();
    const auto status = FetchStatus(options_.out / "status.json");
    const Json::json_pointer count("/bender/parts_bent");
    if (status && status->contains(count) && status->at(count) == part) return {};
    std::this_thread::sleep_for(kPollPeriod);
  }
  return hal::Fail(hal::ErrorKind::kDevice, "bendloopd has not seen the bender's part; see " +
                                                Log("bendloopd.log").string());
}

hal::Result<RunResult> Demo::MakePart(std::uint32_t part) {
  std::cout << "\n"
            << Paint("Part " + std::to_string(part), Style::kStrong, options_.colour) << "\n"
            << std::flush;
  if (auto asked = bender_->WriteLine("bend"); !asked) return hal::Fail(asked.error());
  const auto bent = bender_->Expect("bent", kBendTimeout);
  if (!bent) return hal::Fail(bent.error());
  if (auto seen = AwaitCount(part); !seen) return hal::Fail(seen.error());
  const fs::path tray = options_.out / "tray" / fs::path(*bent).filename();
  std::cout << "bent, scanning ...\n" << std::flush;
  const auto scan = ScanOf(tray);
  if (!scan) return hal::Fail(scan.error());
  if (auto asked = scanner_->WriteLine("scan " + scan->string()); !asked) {
    return hal::Fail(asked.error());
  }
  const fs::path file = options_.out / "results" / (NameOf(part) + ".json");
  auto arrived = AwaitResult(file);
  progress_.End();
  if (!arrived) return hal::Fail(arrived.error());
  const auto text = ReadWholeFile(file);
  if (!text) return hal::Fail(text.error());
  auto result = ReadResultJson(*text, file.string());
  if (result)
    std::cout << RunText(*result, options_.colour, SentenceColumns(STDOUT_FILENO)) << std::flush;
  return result;
}

hal::Result<void> Demo::Conclude() {
  std::cout << "\n"
            << Paint("Largest deviations from the nominal", Style::kStrong, options_.colour)
            << "\n";
  std::vector<Worst> worst;
  Table table({{"part", Align::kRight},
               {"length mm", Align::kDecimal},
               {"rotation deg", Align::kDecimal},
               {"angle deg", Align::kDecimal},
               {"of tolerance", Align::kDecimal}});
  for (const RunResult& result : results_) {
    worst.push_back(WorstOf(result));
    const Worst& last = worst.back();
    table.Add({std::to_string(worst.size()), Fixed(last.length_mm, 3), Fixed(last.rotation_deg, 3),
               Fixed(last.angle_deg, 3), Fixed(last.of_tolerance, 2)});
  }
  std::cout << table.Render(options_.colour);
  const std::string last = NameOf(static_cast<std::uint32_t>(results_.size()));
  const auto show = [&](const char* what, const fs::path& path) {
    std::cout << what << path.string() << "\n";
  };
  std::cout << "\n";
  std::error_code error;
  if (fs::exists(options_.out / "report.html", error)) {
    show("report    ", options_.out / "report.html");
  }
  show("results   ", options_.out / "results");
  show("sessions  ", options_.out / "sessions");
  std::cout << "again     bendloop replay "
            << (options_.out / "sessions" / (last + ".session")).string()
            << " \\\n            --config " << (options_.out / "cell.toml").string() << "\n"
            << std::flush;
  if (worst.size() >= 2 && !(worst[1].of_tolerance < worst[0].of_tolerance)) {
    return hal::Fail(hal::ErrorKind::kRefused, "the second part is not better than the first");
  }
  return {};
}

hal::Result<void> Demo::Run() {
  auto done = RunParts();
  // The others have nothing to lose.
  if (!done && daemon_) {
    (void)daemon_->Stop(kFarewell);
    RemoveUnfinished(options_.out);
  }
  return done;
}

hal::Result<void> Demo::RunParts() {
  if (auto started = StartProcesses(); !started) return started;
  for (std::uint32_t part = 1; part <= options_.parts; ++part) {
    auto result = MakePart(part);
    if (!result) return hal::Fail(result.error());
    results_.push_back(std::move(*result));
  }
  // The daemon ends by itself after the last part, with everything on the disk.
  const auto deadline = Clock::now() + kStartTimeout;
  while (!daemon_->Exited() && Clock::now() < deadline && g_signal == 0) {
    std::this_thread::sleep_for(kPollPeriod);
  }
  const int code = daemon_->Stop(5s);
  if (code != 0) {
    return hal::Fail(hal::ErrorKind::kDevice, "bendloopd ended with exit code " +
                                                  std::to_string(code) + "; see " +
                                                  Log("bendloopd.log").string());
  }
  return Conclude();
}

}  // namespace

hal::Result<void> RunDemo(const DemoOptions& options) {
  const CatchInterrupts interrupts;
  const auto lock = LockDemoFolder(options.out);
  if (!lock) return hal::Fail(lock.error());
  if (auto written = WriteDemoFiles(options); !written) return written;
  auto cell = config::LoadCell(options.out / "cell.toml");
  if (!cell) return hal::Fail(cell.error());
  const auto plan = MakePartPlan(*cell);
  if (!plan) return hal::Fail(plan.error());
  if (auto written = WriteFirstProgram(options.out, *cell); !written) return written;
  std::cout << "bendloop demo: '" << plan->part << "', " << plan->nominal.bend_count()
            << " bends, pipe radius " << plan->pipe_radius_mm << " mm\n";
  return Demo(options, std::move(*cell), plan->nominal_length_mm).Run();
}

}  // namespace bendloop::host
