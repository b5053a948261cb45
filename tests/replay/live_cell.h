// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "config/load.h"
#include "drivers/simulated_bender/simulated_bender.h"
#include "drivers/simulated_scanner/simulated_scanner.h"
#include "drivers/simulated_scanner/virtual_scan_source.h"
#include "firmware-host/cell/part_plan.h"
#include "firmware-host/cli/demo/child_process.h"
#include "firmware-host/daemon/status_client.h"
#include "firmware-host/result/result_json.h"
#include "pipeline/correction/material.h"
#include "program.h"

namespace bendloop::testing {

// A scan again and again, without a word of where it begins and ends: a scanner without events.
class WordlessSource final : public hal::ProfileSource {
 public:
  // Of so many profiles, the first with this number; of the scan its first `part` profiles.
  WordlessSource(std::shared_ptr<const drivers::VirtualScan> scan, std::size_t part,
                 std::size_t profiles, std::uint64_t first)
      : scan_(std::move(scan)), part_(part), profiles_(profiles), first_(first) {}
  hal::Result<hal::SourceInfo> Open() override {
    next_ = 0;
    return hal::SourceInfo{"virtual scan", "", "", false, scan_->max_points()};
  }
  hal::Result<void> Start() override { return {}; }
  hal::Result<hal::ReadStatus> Read(hal::LaserProfile& profile, hal::ScanEvent&,
                                    std::chrono::nanoseconds) override {
    if (next_ == profiles_) return hal::ReadStatus::kEnd;
    scan_->Make(next_ % part_, profile);
    profile.sequence = first_ + next_;
    profile.t_ns = scan_->TimeOf(0) + static_cast<std::int64_t>(next_) * 1'000'000;
    ++next_;
    return hal::ReadStatus::kProfile;
  }
  void Stop() override {}

 private:
  std::shared_ptr<const drivers::VirtualScan> scan_;
  std::size_t part_;
  std::size_t profiles_;
  std::uint64_t first_;
  std::size_t next_ = 0;
};

// A scan whose tube is moved when half of it is scanned: between two passes, where there are two.
class MovedTubeSource final : public hal::ProfileSource {
 public:
  MovedTubeSource(const std::shared_ptr<const drivers::VirtualScan>& scan,
                  const Eigen::Vector3d& move_mm)
      : source_(scan), still_(scan->profile_count() / 2), move_mm_(move_mm) {}
  hal::Result<hal::SourceInfo> Open() override { return source_.Open(); }
  hal::Result<void> Start() override { return source_.Start(); }
  hal::Result<hal::ReadStatus> Read(hal::LaserProfile& profile, hal::ScanEvent& event,
                                    std::chrono::nanoseconds timeout) override {
    const auto status = source_.Read(profile, event, timeout);
    if (status && *status == hal::ReadStatus::kProfile && ++profiles_ > still_) {
      profile.X_WS.position_mm += move_mm_;  // as if the tube stayed and the sensor did not
    }
    return status;
  }
  void Stop() override { source_.Stop(); }

 private:
  drivers::VirtualScanSource source_;
  std::size_t still_, profiles_ = 0;
  Eigen::Vector3d move_mm_;
};

// A cell of the real daemon between a simulated bender (Modbus TCP) and a simulated scanner (its
// wire protocol, TCP), all over loopback.
class LiveCell {
 public:
  static constexpr std::chrono::seconds kPatience{120 * kSlowness};
  // Coarser scans are quicker ones, and see less of the ends.
  double profile_spacing_mm = 1;

  // `top`: keys of the cell file before its tables.
  explicit LiveCell(const std::string& more = "", const std::string& bender_keys = "",
                    const std::string& top = "") {
    auto part = config::LoadPart(BENDLOOP_SOURCE_DIR "/config/parts/demo.toml");
    EXPECT_TRUE(part);
    config::CellConfig config;
    config.part = *part;
    plan_ = *host::MakePartPlan(config);
    StartBender();
    auto scanner = drivers::SimulatedScanner::Listen(0, kScanner, clock_);
    EXPECT_TRUE(scanner);
    scanner_ = std::move(*scanner);
    serving_ = std::thread([this] {
      while (!stop_) {
        {
          const std::lock_guard lock(mutex_);
          if (scanner_) (void)scanner_->Poll(std::chrono::milliseconds(1));
        }
        std::this_thread::yield();
      }
    });
    std::ofstream(cell_file()) << "schema = \"bendloop.cell/1\"\nname = \"test\"\npart = \""
                               << BENDLOOP_SOURCE_DIR "/config/parts/demo.toml\"\n"
                               << "state_dir = \"state\"\n"
                               << top << "[scanner]\nkind = \"stream\"\nport = " << scanner_->port()
                               << "\nqueue_profiles = 8192\n"
                               << "[bender]\nlink = \"modbus-tcp\"\nport = " << bender_->port()
                               << "\nregister_map = \"" BENDLOOP_SOURCE_DIR
                                  "/config/register-maps/default.toml\"\n"
                               << bender_keys << more;
  }
  ~LiveCell() {
    daemon_.reset();
    stop_ = true;
    serving_.join();
    bender_->Stop();
  }

  void StartDaemon() {
    auto started = host::ChildProcess::Start(BENDLOOP_BIN_DIR "/bendloopd",
                                             {"--config", cell_file()}, scratch_ / "bendloopd.log");
    ASSERT_TRUE(started) << started.error().message;
    daemon_.emplace(std::move(*started));
    ASSERT_TRUE(Becomes("/state", "waiting for a scan")) << log();
  }
  void StopDaemon() {
    ASSERT_TRUE(daemon_);
    EXPECT_EQ(daemon_->Stop(std::chrono::seconds(60 * kSlowness)), 0) << log();
    daemon_.reset();
  }
  // As a power cut does.
  void KillDaemon() {
    ASSERT_TRUE(daemon_);
    daemon_->Stop(std::chrono::milliseconds(0));
    daemon_.reset();
  }

  drivers::SimulatedBender& bender() { return *bender_; }
  // The tube as it truly is; the daemon has seen that it was bent.
  hal::BendProgram Bend() {
    const auto part = bender_->Bend();
    EXPECT_TRUE(part) << part.error().message;
    if (!part) return {};
    if (daemon_) {
      EXPECT_TRUE(Becomes("/bender/parts_bent", part->serial)) << log();
    }
    return part->tube;
  }
  // Until the daemon has looked at the bender from now on.
  void AwaitALook() {
    Misbehave("mode not-ready");
    EXPECT_TRUE(Becomes("/bender/state", "not ready")) << log();
    Misbehave("mode idle");
    EXPECT_TRUE(Becomes("/bender/state", "idle")) << log();
  }
  void Misbehave(const char* how) {
    const auto done = bender_->Misbehave(how);
    EXPECT_TRUE(done) << done.error().message;
  }

  std::shared_ptr<const drivers::VirtualScan> ScanOf(const hal::BendProgram& tube) {
    return ScanOf(tube, plan_.pipe_radius_mm);
  }
  std::shared_ptr<const drivers::VirtualScan> ScanOf(const hal::BendProgram& tube,
                                                     double pipe_radius_mm) {
    drivers::VirtualScanOptions options;
    options.seed = ++scans_;
    options.path.profile_spacing_mm = profile_spacing_mm;
    options.path.views_deg = drivers::SpreadViewsDeg(2);
    options.rays = kRays;
    options.profiles_per_second = 4000;
    options.start_t_ns = static_cast<std::int64_t>(scans_) * 100'000'000'000;
    return std::make_shared<const drivers::VirtualScan>(
        drivers::LayOnTable({pipe_radius_mm, tube, {}}, options.seed), options);
  }
  void Trigger(const hal::BendProgram& tube, drivers::ScanPace pace = drivers::ScanPace::kMax) {
    auto scan = ScanOf(tube);
    const std::lock_guard lock(mutex_);
    scanner_->Trigger(std::move(scan), pace);
  }
  void Trigger(std::shared_ptr<const drivers::VirtualScan> scan) {
    const std::lock_guard lock(mutex_);
    scanner_->Trigger(std::move(scan), drivers::ScanPace::kMax);
  }
  // A scan of two passes between which the tube is moved.
  void TriggerMoved(const hal::BendProgram& tube, const Eigen::Vector3d& move_mm) {
    auto source = std::make_unique<MovedTubeSource>(ScanOf(tube), move_mm);
    EXPECT_TRUE(source->Open());
    const std::lock_guard lock(mutex_);
    scanner_->device().Trigger(std::move(source), drivers::ScanPace::kMax);
  }
  // Sweeps without a beginning and an end, e.g. half of one, over the first of so many pieces of
  // the scan; of how many profiles.
  std::size_t Sweep(const hal::BendProgram& tube, double times, std::size_t pieces = 1) {
    const auto scan = ScanOf(tube);
    const auto profiles =
        static_cast<std::size_t>(times * static_cast<double>(scan->profile_count()));
    auto source =
        std::make_unique<WordlessSource>(scan, scan->profile_count() / pieces, profiles, swept_);
    swept_ += profiles;
    EXPECT_TRUE(source->Open());
    const std::lock_guard lock(mutex_);
    scanner_->device().Trigger(std::move(source), drivers::ScanPace::kMax);
    return profiles;
  }
  // The scanner is switched off.
  void StopScanner() {
    const std::lock_guard lock(mutex_);
    scanner_.reset();
  }
  // The scanner is switched off and on; the daemon finds it again.
  void RestartScanner() {
    {
      const std::lock_guard lock(mutex_);
      const std::uint16_t port = scanner_->port();
      scanner_.reset();
      auto scanner = drivers::SimulatedScanner::Listen(port, kScanner, clock_);
      ASSERT_TRUE(scanner) << scanner.error().message;
      scanner_ = std::move(*scanner);
    }
    ASSERT_TRUE(Until([&] {
      const std::lock_guard lock(mutex_);
      return scanner_->has_host();
    })) << log();
    ASSERT_TRUE(Becomes("/state", "waiting for a scan")) << log();
  }

  // The part's result, as soon as its commit says `outcome` ("" for any).
  std::optional<host::RunResult> Result(unsigned number, const std::string& outcome = "") {
    char name[32];
    std::snprintf(name, sizeof name, "part-%04u.json", number);
    const auto file = scratch_ / ("state/results/" + std::string(name));
    std::optional<host::RunResult> found;
    Until([&] {
      if (!std::filesystem::exists(file)) return false;
      auto result = host::ReadResultJson(Slurp(file), name);
      if (!result) return false;
      if (!outcome.empty() && (!result->bender || host::Name(result->bender->outcome) != outcome)) {
        return false;
      }
      found = std::move(*result);
      return true;
    });
    EXPECT_TRUE(found) << name << " " << outcome << "\n" << log();
    return found;
  }
  std::optional<host::RunResult> Scan(const hal::BendProgram& tube, unsigned number,
                                      const std::string& outcome) {
    Trigger(tube);
    return Result(number, outcome);
  }

  // Until the status has what `is_so` accepts at a JSON pointer.
  template <class IsSo>
  bool BecomesSo(const std::string& pointer, IsSo is_so) {
    return Until([&] {
      const auto status = host::FetchStatus(scratch_ / "state/status.json");
      const host::Json::json_pointer at(pointer);
      return status && status->contains(at) && is_so(status->at(at));
    });
  }
  bool Becomes(const std::string& pointer, const host::Json& value) {
    return BecomesSo(pointer, [&](const host::Json& is) { return is == value; });
  }
  bool Reaches(const std::string& pointer, double least) {
    return BecomesSo(pointer, [&](const host::Json& is) { return is.get<double>() >= least; });
  }
  // Until the status has this alarm among the "alarms" or the "alarms_ended".
  bool HasAlarm(const std::string& code, const char* where = "alarms") {
    return Until([&] { return Shows(code, where) == true; });
  }
  bool LosesAlarm(const std::string& code) {
    return Until([&] { return Shows(code, "alarms") == false; });
  }
  // That the scanner has sent to their end.
  std::size_t ScansFinished() {
    const std::lock_guard lock(mutex_);
    return scanner_->scans_finished();
  }
  // A sweep is over when no points have come for so long.
  void AwaitSilence(std::chrono::milliseconds silence) {
    ASSERT_TRUE(Becomes("/health/queue_now", 0)) << log();
    const auto over = std::chrono::steady_clock::now() + silence;
    Until([&] { return std::chrono::steady_clock::now() > over; });
  }
  std::size_t results() const {
    std::size_t count = 0;
    std::error_code none;
    for (std::filesystem::directory_iterator it(scratch_ / "state/results", none), end; it != end;
         ++it) {
      ++count;
    }
    return count;
  }
  template <class Condition>
  static bool Until(Condition condition) {
    const auto deadline = std::chrono::steady_clock::now() + kPatience;
    while (std::chrono::steady_clock::now() < deadline) {
      if (condition()) return true;
      std::this_thread::yield();
    }
    return false;
  }

  std::string cell_file() const { return (scratch_ / "cell.toml").string(); }
  std::string log() const { return Slurp(scratch_ / "bendloopd.log"); }
  const Scratch& scratch() const { return scratch_; }
  const host::PartPlan& plan() const { return plan_; }

 private:
  // Whether `where` has it; nullopt: the daemon does not answer.
  std::optional<bool> Shows(const std::string& code, const char* where) const {
    const auto status = host::FetchStatus(scratch_ / "state/status.json");
    if (!status || !status->contains(where)) return std::nullopt;
    for (const host::Json& alarm : status->at(where)) {
      if (alarm.at("code") == code) return true;
    }
    return false;
  }

  static constexpr std::uint32_t kRays = 200;
  inline static const drivers::WireIdentity kScanner{"simulated", "1", "1", "none", kRays};

  void StartBender() {
    drivers::SimulatedBenderOptions options;
    auto map = config::LoadRegisterMap(BENDLOOP_SOURCE_DIR "/config/register-maps/default.toml");
    ASSERT_TRUE(map);
    options.map = *map;
    options.program.part_number = plan_.part_number;
    options.program.sequence = 1;
    auto first = pipeline::InitialProgram(plan_.nominal, plan_.correction.material);
    ASSERT_TRUE(first);
    options.program.program = *first;
    options.pipe_radius_mm = plan_.pipe_radius_mm;
    options.cycle = std::chrono::milliseconds(20);
    options.physics.springback_20_deg = plan_.correction.material.springback_at_20_deg + 0.7;
    options.physics.springback_120_deg = plan_.correction.material.springback_at_120_deg + 1.7;
    auto bender = drivers::SimulatedBender::Start(std::move(options));
    ASSERT_TRUE(bender);
    bender_ = std::move(*bender);
  }

  Scratch scratch_;
  hal::SteadyClock clock_;
  host::PartPlan plan_;
  std::unique_ptr<drivers::SimulatedBender> bender_;
  std::mutex mutex_;  // of the scanner
  std::unique_ptr<drivers::SimulatedScanner> scanner_;
  std::atomic<bool> stop_{false};
  std::thread serving_;
  std::optional<host::ChildProcess> daemon_;
  std::uint64_t scans_ = 0;
  std::uint64_t swept_ = 0;  // profiles
};

}  // namespace bendloop::testing
