// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/load/load_run.h"

#include <spdlog/spdlog.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>

#include "config/load.h"
#include "firmware-host/cell/cell_loop.h"
#include "firmware-host/cell/tube_rules.h"
#include "firmware-host/daemon/part_keeper.h"
#include "firmware-host/ledger/moment.h"
#include "tests/bench/load/load_source.h"

namespace bendloop::bench {
namespace {

using namespace std::chrono_literals;

constexpr auto kPause = 200ms;           // between the parts
constexpr std::uint64_t kLineStep = 97;  // from part to part: each has noise of its own
constexpr double kShortestSample = 0.02;
constexpr double kMostValues = 200'000;  // of one list; of more, every so manieth is kept

void WritePart(const std::filesystem::path& path) {
  const hal::Tube tube = LoadTube(0);
  std::ofstream part(path);
  part << "schema = \"bendloop.part/1\"\nname = \"load\"\npart_number = 77\npipe_radius_mm = "
       << tube.pipe_radius_mm << "\nrow = [\n";
  for (const hal::BendRow& row : tube.program.rows) {
    part << "  {length_mm = " << row.length_mm;
    if (row.rotation_deg != 0) part << ", rotation_deg = " << row.rotation_deg;
    if (row.bend_radius_mm) {
      part << ", angle_deg = " << row.angle_deg << ", bend_radius_mm = " << *row.bend_radius_mm;
    }
    part << "},\n";
  }
  part << "]\n";
}

hal::Result<config::CellConfig> MakeCell(const std::filesystem::path& directory) {
  std::filesystem::create_directories(directory);
  WritePart(directory / "part.toml");
  std::ofstream(directory / "cell.toml")
      << "schema = \"bendloop.cell/1\"\nname = \"load\"\npart = \"part.toml\"\n"
      << "state_dir = \".\"\n[scanner]\nkind = \"simulated\"\n[bender]\nlink = "
         "\"simulated\"\nregister_map = \""
      << BENDLOOP_SOURCE_DIR "/config/register-maps/default.toml\"\n"
      << "[interlocks]\nmax_sigma_length_mm = 1.0  # lines 1 mm apart\n"
      << "[record]\ndisk_budget_mb = 1500\n";
  return config::LoadCell(directory / "cell.toml");
}

double MegabytesOf(const char* key) {
  std::ifstream file("/proc/self/status");
  for (std::string line; std::getline(file, line);) {
    if (line.rfind(key, 0) == 0) return std::stod(line.substr(line.find(':') + 1)) / 1024;
  }
  return 0;
}

// Resident memory by the kernel's short list: cheap enough to ask for while scanning.
double ResidentMegabytes() {
  std::ifstream file("/proc/self/statm");
  std::uint64_t pages = 0, resident = 0;
  file >> pages >> resident;
  return static_cast<double>(resident) * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1 << 20);
}

// Takes the memory of `count` values now, touched.
void Provide(std::vector<double>& values, double count) {
  values.assign(static_cast<std::size_t>(count) + 1, 0.0);
  values.clear();
}

double CpuSeconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

// Plays the operator: starts the next scan when the part before is decided, and takes the times.
class LoadCell {
 public:
  LoadCell(const LoadCase& load, const config::CellConfig& cell, host::PartPlan plan,
           host::StateStore store)
      : load_(load),
        cell_(cell),
        plan_(std::move(plan)),
        store_(std::move(store)),
        keeper_(store_, cell_, plan_, alarms_) {
    for (const double off_deg : {kBentOffDeg, -kBentOffDeg}) {
      const hal::Tube tube = LoadTube(off_deg);
      truths_.push_back(tube.program);
      scans_.push_back(MakeLoadScan(tube, truths_.size()));
    }
    for (const LoadScan& scan : scans_) {
      orders_.push_back({&scan, static_cast<std::uint64_t>(load.seconds * load.profiles_per_second),
                         load.profiles_per_second});
    }
    ProvideLists();
  }

  hal::Result<LoadResult> Run();

 private:
  void ProvideLists();
  host::CellPorts Ports();
  void Turn();
  void PartDone(host::PartOutcome outcome);
  void AddErrors(const hal::BendProgram& measured);
  void Viewed(const pipeline::LiveView& view);
  double MsSince(std::int64_t due_ns) const {
    return 1e-6 * static_cast<double>(clock_.Now().count() - due_ns);
  }

  const LoadCase load_;
  const config::CellConfig& cell_;
  const host::PartPlan plan_;
  hal::SteadyClock clock_;
  host::StateStore store_;
  host::AlarmBoard alarms_{[] { return host::SystemMoment().unix_ms; }};
  host::PartKeeper keeper_;
  host::StatusBoard board_;
  std::unique_ptr<host::BenderDesk> desk_;
  std::unique_ptr<host::Recorder> recorder_;
  std::vector<hal::BendProgram> truths_;
  std::vector<LoadScan> scans_;
  std::vector<LoadSource::Order> orders_;
  LoadSource source_{clock_};
  host::ProfileRing* ring_ = nullptr;
  const host::AcquisitionCounters* counters_ = nullptr;
  LoadResult result_;
  std::uint64_t started_ = 0;
  bool scanning_ = false;
  std::uint64_t viewed_ = 0;
  std::uint64_t viewed_of_all_ = 0;
  std::uint64_t live_stride_ = 1;
  std::chrono::nanoseconds next_at_{0};
  std::chrono::nanoseconds sampled_at_{0};
};

void LoadCell::ProvideLists() {
  const auto parts = static_cast<double>(load_.parts);
  const double seconds = load_.seconds * parts;
  const double profiles = seconds * load_.profiles_per_second;
  live_stride_ = static_cast<std::uint64_t>(std::ceil(profiles / kMostValues));
  Provide(result_.live_ms, std::min(profiles, kMostValues));
  result_.sample_seconds = std::max(kShortestSample, seconds / kMostValues);
  for (auto* samples : {&result_.queue, &result_.lateness_ms, &result_.memory_mb}) {
    Provide(*samples, 1.2 * seconds / result_.sample_seconds);
  }
  for (auto* of_part : {&result_.lra_ms, &result_.committed_ms, &result_.part_memory_mb}) {
    Provide(*of_part, parts);
  }
  for (auto* errors :
       {&result_.length_error_mm, &result_.rotation_error_deg, &result_.angle_error_deg}) {
    errors->resize(plan_.nominal.rows.size());
    for (auto& of_row : *errors) Provide(of_row, parts);
  }
}

host::CellPorts LoadCell::Ports() {
  host::CellPorts ports;
  ports.clock = &clock_;
  ports.desk = desk_.get();
  ports.board = &board_;
  ports.recorder = recorder_.get();
  ports.identify = [this] { return keeper_.Identify(); };
  // Each part begins a lot: the tubes do not follow the program.
  ports.lot = [] { return std::optional<pipeline::LotState>(); };
  ports.part_done = [this](host::PartOutcome outcome) { PartDone(std::move(outcome)); };
  ports.scan_failed = [this](const host::FailedScan& failed) {
    ++result_.failed;
    if (result_.first_reason.empty()) result_.first_reason = failed.error.message;
    scanning_ = false;
    next_at_ = clock_.Now() + kPause;
  };
  ports.viewed = [this](const pipeline::LiveView& view) { Viewed(view); };
  ports.alive = [this] { Turn(); };
  return ports;
}

void LoadCell::Turn() {
  const auto now = clock_.Now();
  if (scanning_ && now >= sampled_at_) {
    sampled_at_ =
        now + std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 * result_.sample_seconds));
    result_.queue.push_back(static_cast<double>(ring_->Filled()));
    result_.lateness_ms.push_back(1e-6 * static_cast<double>(counters_->lateness_last_ns));
    result_.memory_mb.push_back(ResidentMegabytes());
  }
  if (scanning_ || now < next_at_ || started_ == load_.parts) return;
  scanning_ = true;
  viewed_ = 0;
  LoadSource::Order& order = orders_[started_ % orders_.size()];
  order.first_line = kLineStep * started_++;
  source_.Trigger(&order);
}

void LoadCell::Viewed(const pipeline::LiveView& view) {
  const double now_ms = MsSince(source_.first_due_ns());
  for (; viewed_ < view.profiles; ++viewed_) {
    if (viewed_of_all_++ % live_stride_ != 0) continue;
    result_.live_ms.push_back(now_ms -
                              1e3 * static_cast<double>(viewed_) / load_.profiles_per_second);
  }
}

void LoadCell::PartDone(host::PartOutcome outcome) {
  const double done_ms = MsSince(source_.last_due_ns());
  result_.lra_ms.push_back(done_ms - (outcome.latency.end_ms - outcome.latency.lra_ms));
  if (outcome.end == host::PartEnd::kCorrected) {
    ++result_.corrected;
    result_.committed_ms.push_back(done_ms);
  } else {
    ++result_.refused;
    if (result_.first_reason.empty() && !outcome.reasons.empty()) {
      result_.first_reason = outcome.reasons.front();
    }
  }
  for (const auto& stage : outcome.result.measurement.timing) {
    auto& times = result_.stage_ms[stage.stage];
    if (times.empty()) Provide(times, static_cast<double>(load_.parts));
    times.push_back(stage.ms);
  }
  if (outcome.result.inspection) AddErrors(outcome.result.inspection->measured.program);
  keeper_.Keep(std::move(outcome));
  // The long run keeps its sessions within the disk budget; results are small but many.
  result_.part_memory_mb.push_back(ResidentMegabytes());
  ++result_.parts;
  scanning_ = false;
  next_at_ = clock_.Now() + kPause;
}

void LoadCell::AddErrors(const hal::BendProgram& measured) {
  const auto& truth = truths_[(started_ - 1) % truths_.size()].rows;
  const auto& rows = measured.rows;
  if (rows.size() != truth.size()) {
    ++result_.wrong_bends;
    return;
  }
  for (std::size_t i = 0; i < rows.size(); ++i) {
    result_.length_error_mm[i].push_back(rows[i].length_mm - truth[i].length_mm);
    if (i + 1 == rows.size()) break;  // the last row is a straight
    result_.angle_error_deg[i].push_back(rows[i].angle_deg - truth[i].angle_deg);
    if (i == 0) continue;  // the first bend's plane is where rotation begins
    result_.rotation_error_deg[i].push_back(
        hal::WrapRotationDeg(rows[i].rotation_deg - truth[i].rotation_deg));
  }
}

hal::Result<LoadResult> LoadCell::Run() {
  if (auto loaded = keeper_.Load(plan_); !loaded) return hal::Fail(loaded.error());
  host::BenderDesk::Options desk;
  desk.journal = store_.journal();
  desk.pipe_radius_mm = plan_.pipe_radius_mm;
  desk.commit = plan_.commit;
  desk.ledger = host::LedgerRulesOf(cell_);
  desk.preload.part_number = plan_.part_number;
  desk.preload.program = plan_.nominal;
  auto opened = host::BenderDesk::Open(cell_.bender, desk, clock_);
  if (!opened) return hal::Fail(opened.error());
  desk_ = std::move(*opened);
  host::RecorderOptions recorder;
  recorder.directory = cell_.record.directory;
  recorder.limits.most_sessions_bytes = cell_.record.disk_budget_mb << 20;
  if (load_.record) recorder_ = std::make_unique<host::Recorder>(recorder, clock_);

  host::CellLoopOptions options;
  options.scan.max_seconds = std::max(cell_.scan.max_seconds, 2 * load_.seconds);
  options.scan.min_profiles = cell_.scan.min_profiles;
  options.max_parts = load_.parts;
  const hal::SourceInfo info = LoadSource::Info();
  host::ProfileRing ring(cell_.scanner.queue_profiles, info.max_points);
  ring_ = &ring;
  host::AcquisitionOptions acquire;
  acquire.realtime.enabled = true;
  host::Acquisition acquisition(source_, info, ring, clock_, acquire);
  host::CellLoop loop(plan_, Ports(), options);
  counters_ = &acquisition.counters();
  if (auto started = acquisition.Start(); !started) return hal::Fail(started.error());
  if (const auto note = host::FavourPipeline(acquire.realtime); note && !note->empty()) {
    result_.realtime_note = *note;
  }
  std::ofstream("/proc/self/clear_refs") << "5";  // the peak begins here
  const double cpu_s = CpuSeconds();
  const auto begun = clock_.Now();
  loop.Run(acquisition, ring, info);
  const double wall_s = std::chrono::duration<double>(clock_.Now() - begun).count();
  result_.cpu_percent = 100 * (CpuSeconds() - cpu_s) / wall_s;
  result_.peak_mb = MegabytesOf("VmHWM");
  acquisition.Stop();
  const host::AcquisitionCounters& counters = acquisition.counters();
  result_.profiles = counters.profiles;
  result_.points = counters.points;
  result_.dropped = counters.dropped_profiles;
  result_.queue_peak = counters.queue_peak;
  result_.queue_capacity = ring.capacity();
  result_.lateness_peak_ms = 1e-6 * static_cast<double>(counters.lateness_peak_ns);
  if (const std::string& note = acquisition.realtime_note(); !note.empty()) {
    result_.realtime_note += " " + note;
  }
  static_cast<void>(keeper_.FlushWithin(std::chrono::hours(1)));
  if (recorder_) {
    recorder_->Flush();
    result_.recorder_dropped = recorder_->counters().dropped_profiles;
    result_.problem = recorder_->counters().last_error;
  }
  return result_;
}

}  // namespace

LoadResult RunLoad(const LoadCase& load, const std::filesystem::path& directory) {
  spdlog::set_level(spdlog::level::err);
  host::KeepMemory();
  LoadResult failed;
  const auto run = [&]() -> hal::Result<LoadResult> {
    auto cell = MakeCell(directory);
    if (!cell) return hal::Fail(cell.error());
    auto plan = host::MakePartPlan(*cell);
    if (!plan) return hal::Fail(plan.error());
    auto store = host::StateStore::Open(cell->state_dir);
    if (!store) return hal::Fail(store.error());
    return LoadCell(load, *cell, std::move(*plan), std::move(*store)).Run();
  };
  auto result = run();
  if (result) return *result;
  failed.problem = result.error().message;
  return failed;
}

LoadResult RunLoadApart(const LoadCase& load, const std::filesystem::path& directory) {
  LoadResult failed;
  failed.problem = "the run ended without figures";
  std::array<int, 2> ends{};
  if (pipe(ends.data()) != 0) return failed;
  const pid_t child = fork();
  if (child == 0) {
    close(ends[0]);
    const std::string text = nlohmann::json(RunLoad(load, directory)).dump();
    for (std::size_t sent = 0; sent < text.size();) {
      const ssize_t n = write(ends[1], text.data() + sent, text.size() - sent);
      if (n <= 0) break;
      sent += static_cast<std::size_t>(n);
    }
    close(ends[1]);
    _exit(0);
  }
  close(ends[1]);
  std::string text;
  std::array<char, 65536> block{};
  for (ssize_t n = 0; (n = read(ends[0], block.data(), block.size())) > 0;) {
    text.append(block.data(), static_cast<std::size_t>(n));
  }
  close(ends[0]);
  if (child > 0) waitpid(child, nullptr, 0);
  const auto json = nlohmann::json::parse(text, nullptr, false);
  return json.is_object() ? json.get<LoadResult>() : failed;
}

}  // namespace bendloop::bench
