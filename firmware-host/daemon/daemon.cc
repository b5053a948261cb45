// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/daemon.h"

#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <thread>
#include <utility>

#include "firmware-host/alarms/alarm_text.h"
#include "firmware-host/cell/bender_desk.h"
#include "firmware-host/cell/cell_loop.h"
#include "firmware-host/cell/life_signs.h"
#include "firmware-host/cell/part_plan.h"
#include "firmware-host/cell/plc_reporter.h"
#include "firmware-host/cell/service_times.h"
#include "firmware-host/cell/service_unit.h"
#include "firmware-host/cell/tube_rules.h"
#include "firmware-host/console/output_file.h"
#include "firmware-host/console/version.h"
#include "firmware-host/daemon/cell_alarms.h"
#include "firmware-host/daemon/daemon_settings.h"
#include "firmware-host/daemon/last_run.h"
#include "firmware-host/daemon/part_keeper.h"
#include "firmware-host/daemon/part_setter.h"
#include "firmware-host/daemon/plc_desk.h"
#include "firmware-host/daemon/requests.h"
#include "firmware-host/daemon/scanner_post.h"
#include "firmware-host/daemon/service_notify.h"
#include "firmware-host/daemon/state_store.h"
#include "firmware-host/daemon/status_server.h"
#include "firmware-host/daemon/trouble_log.h"
#include "firmware-host/daemon/upkeep.h"
#include "firmware-host/recorder/recorder.h"
#include "firmware-host/result/words.h"
#include "firmware-host/workers/spare_memory.h"
#include "firmware-host/workers/want_of_memory.h"

namespace bendloop::host {
namespace {

using namespace std::chrono_literals;

std::atomic<bool> g_stop{false};
std::atomic<bool> g_hung_up{false};

// Shorter than a look at the bender takes to come round.
constexpr auto kReportPeriod = 50ms;

// What a full disk did not take is tried again; each look at a disk that takes nothing costs some
// work.
constexpr auto kPayPeriod = 5s;

// A reload's old settings are taken up again for less than the watchdog waits.
constexpr int kMostTries = 20;
constexpr auto kTryAgain = 200ms;
constexpr const char* kShort = "out of memory";  // so short that it wants none itself

spdlog::level::level_enum LevelOf(config::LogLevel level) {
  switch (level) {
    case config::LogLevel::kDebug:
      return spdlog::level::debug;
    case config::LogLevel::kInfo:
      return spdlog::level::info;
    case config::LogLevel::kWarning:
      return spdlog::level::warn;
    case config::LogLevel::kError:
      break;
  }
  return spdlog::level::err;
}

}  // namespace

class Daemon::Impl {
 public:
  Impl(const DaemonOptions& options, DaemonSettings settings, StateStore store)
      : options_(options),
        cell_(std::move(settings.cell)),
        own_part_(std::make_shared<const PartPlan>(std::move(settings.plan))),
        store_(std::move(store)),
        notify_(clock_),
        keeper_(store_, cell_, *own_part_, alarms_.board()),
        parts_(cell_, own_part_, clock_, keeper_, alarms_.board()),
        plc_(alarms_.board()),
        reporter_(clock_),
        upkeep_(cell_.storage, clock_, alarms_.board(), keeper_, board_),
        requests_({store_, parts_, keeper_, alarms_.board(), plc_}),
        scanner_(cell_, clock_, alarms_.board(), notify_, board_) {}

  hal::Result<void> Prepare();
  int Run();
  // What it shall go by from now on: empty when Run() ended for good.
  std::optional<DaemonSettings> TakeNext() { return std::exchange(next_, std::nullopt); }
  // What it went by until then, with next_.
  DaemonSettings TakeBefore() { return std::move(*before_); }
  // Settings that were asked for and could not be taken up.
  void ReloadRefused(const std::string& why);

 private:
  hal::Result<void> ServeStatus();
  CellPorts Ports();
  void BenderHeard(const BenderReading& heard);
  void Viewed(const pipeline::LiveView& view);
  void OrdersHeard(const hal::PlcOrders& orders);
  void TellPlc();
  std::string BetweenParts(bool correction_waits);
  void TakeHangUp();
  void PayDebts();
  void ShowLot();
  void ShowLock();

  const DaemonOptions options_;
  const config::CellConfig cell_;
  const std::shared_ptr<const PartPlan> own_part_;
  hal::SteadyClock clock_;
  StateStore store_;
  StatusBoard board_;
  ServiceNotify notify_;
  CellAlarms alarms_;
  PartKeeper keeper_;
  PartSetter parts_;
  PlcDesk plc_;
  PlcReporter reporter_;
  Upkeep upkeep_;
  Requests requests_;
  ScannerPost scanner_;
  std::optional<DaemonSettings> next_;  // read, and good
  std::optional<DaemonSettings> before_;
  std::chrono::nanoseconds reported_{0};
  std::chrono::nanoseconds debts_due_{0};
  std::unique_ptr<BenderDesk> desk_;
  std::unique_ptr<Recorder> recorder_;
  std::unique_ptr<StatusServer> server_;
  TroubleLog bender_trouble_;
  std::size_t bends_told_ = 0;
  bool bender_known_ = false;
};

hal::Result<void> Daemon::Impl::Prepare() {
  if (auto fits = CheckWatchdog({.watchdog = notify_.period()}); !fits) return fits;
  if (auto loaded = keeper_.Load(*own_part_); !loaded) return hal::Fail(loaded.error());
  if (auto mended = MendJournal(store_.journal()); !mended) return mended;
  BenderDesk::Options desk;
  desk.journal = store_.journal();
  desk.pipe_radius_mm = own_part_->pipe_radius_mm;
  desk.commit = own_part_->commit;
  desk.ledger = LedgerRulesOf(cell_);
  if (cell_.bender.link == config::BenderKind::kSimulated) {
    auto first = pipeline::InitialProgram(own_part_->nominal, own_part_->correction.material);
    if (!first) return hal::Fail(first.error());
    desk.preload.part_number = own_part_->part_number;
    desk.preload.program = std::move(*first);
  }
  auto opened = BenderDesk::Open(cell_.bender, desk, clock_);
  if (!opened) return hal::Fail(opened.error());
  desk_ = std::move(*opened);
  spdlog::info("bender: {}", desk_->name());
  const std::string off = WhyNothingIsCorrected(cell_);
  alarms_.board().Set(AlarmCode::kCorrectionsOff, !off.empty(), off);
  for (const std::string& remark : RemarksOn(cell_, TimesOfUnit())) {
    if (remark != off) alarms_.board().Begin(AlarmCode::kSettingsRemark, remark);
  }
  SettleWhatIsOpen(*desk_, keeper_, alarms_.board());
  // From here on the ledger follows the bender: a tube that is bent now is seen. The second look
  // makes sure that the first one's state and program belong together.
  if (desk_->has_bender() && desk_->Look().facts) BenderHeard(desk_->Look());
  ShowLock();  // what these looks have found, too, before anybody is told that all is ready
  RecorderOptions recorder;
  recorder.directory = cell_.record.directory;
  recorder.limits = {cell_.record.disk_budget_mb << 20, cell_.storage.min_free_mb << 20,
                     cell_.storage.max_age_days};
  recorder.results = store_.results();
  recorder.kept = [this] { return desk_->SessionsInHand(); };
  recorder_ = std::make_unique<Recorder>(recorder, clock_);
  board_.Update([&](CellSnapshot& s) {
    s.cell = cell_.name;
    s.part = own_part_->part;
    s.bender = desk_->name();
  });
  ShowLot();
  return ServeStatus();
}

hal::Result<void> Daemon::Impl::ServeStatus() {
  StatusServer::Pages pages;
  pages.status = [this] {
    Json status = StatusJson(board_.Get());
    ShowAlarms(alarms_.board(), status);
    return Dump(status, 2) + "\n";
  };
  pages.metrics = [this] { return MetricsText(board_.Get()) + AlarmMetrics(alarms_.board()); };
  pages.out_of_memory = [this] { board_.OutOfMemory("an answer of the status page"); };
  auto server = StatusServer::Start(options_.status_port, store_.socket(), std::move(pages));
  if (!server) return hal::Fail(server.error());
  server_ = std::move(*server);
  spdlog::info("status: http://127.0.0.1:{}/status", server_->port());
  const Json address = {{"schema", "bendloop.status-address/1"},
                        {"host", "127.0.0.1"},
                        {"port", server_->port()},
                        {"socket", store_.socket().filename().string()},
                        {"pid", getpid()}};
  return WriteOutputFile(store_.status(), Dump(address, 2) + "\n");
}

CellPorts Daemon::Impl::Ports() {
  CellPorts ports;
  ports.clock = &clock_;
  ports.desk = desk_.get();
  ports.board = &board_;
  ports.recorder = recorder_.get();
  ports.reporter = &reporter_;
  ports.part_of_scan = [this](const hal::PlcOrders& orders) { return parts_.OfScan(orders); };
  ports.identify = [this] {
    const ScanIdentity identity = keeper_.Identify();
    spdlog::info("{}: scan begins", identity.session);
    bends_told_ = 0;
    return identity;
  };
  ports.lot = [this] {
    auto lot = keeper_.Lot(parts_.scanned());
    if (!plc_.holds()) return lot;
    if (!lot) lot.emplace();
    lot->held = true;
    return lot;
  };
  ports.part_done = [this](PartOutcome outcome) {
    alarms_.PartDone(AlarmsOf(outcome.result), board_.Get());
    keeper_.Keep(outcome);
    keeper_.KeepAlarms(alarms_.TakeNews());
    plc_.Done(outcome);
    const RunResult& result = outcome.result;
    upkeep_.PartDone(result.inspection ? std::string(Word(result.inspection->verdict)) : "",
                     result.bender && result.bender->outcome == CommitOutcome::kCommitted);
    board_.Update([this](CellSnapshot& s) { s.problem = keeper_.problem(); });
    ShowLot();
  };
  ports.between_parts = [this](bool correction_waits) { return BetweenParts(correction_waits); };
  ports.scan_failed = [this](const FailedScan& failed) {
    alarms_.PartDone(AlarmsOf(failed.identity.session, failed.error), board_.Get());
    keeper_.KeepFailure(failed);
    upkeep_.PartDone("", false);
    plc_.Failed(failed, parts_.is_known() ? parts_.scanned().part_number : 0);
    board_.Update([this](CellSnapshot& s) { s.problem = keeper_.problem(); });
  };
  ports.commit_settled = [this](const SettledCommit& settled) {
    alarms_.board().End(AlarmCode::kCommitUnknown);
    keeper_.Settle(settled);
  };
  ports.bender_heard = [this](const BenderReading& heard) { BenderHeard(heard); };
  ports.viewed = [this](const pipeline::LiveView& view) { Viewed(view); };
  return ports;
}

int Daemon::Impl::Run() {
  CellLoopOptions options;
  options.scan.is_live = cell_.scanner.kind != config::ScannerKind::kSession;
  options.scan.starts_by_event = cell_.scan.end == config::ScanEnd::kEvent;
  options.scan.max_seconds = cell_.scan.max_seconds;
  options.scan.min_profiles = cell_.scan.min_profiles;
  options.scan.ends_by_coverage = cell_.scan.end == config::ScanEnd::kCoverage;
  options.silence = std::chrono::nanoseconds(std::llround(cell_.scan.silence_seconds * 1e9));
  options.max_parts = options_.parts;
  CellPorts ports = Ports();
  CellLoop* running = nullptr;
  ports.alive = [this, &running] {
    notify_.Alive();
    if (g_stop || next_) running->Stop();
    TellPlc();
  };
  std::optional<CellLoop> loop;
  loop.emplace(*own_part_, std::move(ports), options);
  running = &*loop;

  const auto favoured = FavourPipeline(RealtimeOf(cell_.realtime));
  if (!favoured) {
    spdlog::error("{}", favoured.error().message);
    return hal::ExitCode(favoured.error().kind);
  }
  if (!favoured->empty()) alarms_.board().Begin(AlarmCode::kNoRealtime, *favoured);
  notify_.Ready();
  const auto ends = [this] { return g_stop || next_; };
  while (!ends() && scanner_.Serve(*loop)) scanner_.WaitForRetry(*loop, ends);
  next_ ? notify_.Reloading() : notify_.Stopping();
  spdlog::info("{} after {} scans", next_ ? "taking up the new settings" : "stopping",
               loop->parts());
  HasMemoryFor([this] { upkeep_.TellLastShift(); });
  loop.reset();
  board_.Update([](CellSnapshot& s) { s.phase = CellPhase::kStopping; });
  HasMemoryFor([this] { keeper_.KeepAlarms(alarms_.TakeNews()); });
  keeper_.TryAgain();
  const bool is_kept = recorder_->FlushWithin(kDiskBound) && keeper_.FlushWithin(kDiskBound);
  HasMemoryFor([this] { ::unlink(store_.status().c_str()); });
  if (is_kept) return scanner_.exit_code();
  spdlog::error(
      "the disk hangs: recordings that wait for it are lost ({} profiles and events); check "
      "the disk of {}",
      recorder_->counters().queued_items, cell_.record.directory.string());
  spdlog::shutdown();
  // Threads that the disk holds cannot be waited for.
  std::_Exit(hal::ExitCode(hal::ErrorKind::kDevice));
}

void Daemon::Impl::BenderHeard(const BenderReading& heard) {
  if (heard.facts) OrdersHeard(heard.facts->state.orders);
  alarms_.BenderHeard(heard, parts_.number());
  const auto now = clock_.Now();
  if (heard.facts) {
    const std::string lasted = bender_trouble_.Over(now);
    if (!bender_known_ || !lasted.empty()) {
      spdlog::info("bender answers{}: active program {}", lasted, Describe(heard.facts->active));
    }
    bender_known_ = true;
    return;
  }
  const std::string trouble =
      heard.is_journals ? "what the bender does cannot be kept: " : "bender does not answer: ";
  const std::string line = bender_trouble_.Met(trouble + heard.problem, now);
  if (!line.empty()) spdlog::warn("{}", line);
}

// What the PLC says now, of the next scan: its part, and what it asks for.
void Daemon::Impl::OrdersHeard(const hal::PlcOrders& orders) {
  if (plc_.Heard(orders)) requests_.PlcAcknowledges();
  if (parts_.Set(orders)) ShowLot();
}

// From the loop, some twenty times a second: what is new the bender's follower brings to the PLC.
void Daemon::Impl::TellPlc() {
  const auto now = clock_.Now();
  if (now - reported_ < kReportPeriod) return;
  reported_ = now;
  alarms_.board().Set(AlarmCode::kBlockNotTaken, !reporter_.problem().empty(), reporter_.problem());
  const CellSnapshot cell = board_.Get();
  reporter_.Set(plc_.Report(cell.phase, parts_.number(), plc_.holds() || cell.lot.held));
}

// While nothing is scanned or decided; what it returns: CellPorts::between_parts.
std::string Daemon::Impl::BetweenParts(bool correction_waits) {
  // First: what follows may find no memory, again and again.
  if (!SpareMemory::Refill()) board_.OutOfMemory("nothing yet, by what is kept aside");
  // Also of a disk that fills while no scanner is there.
  board_.Update([this](CellSnapshot& s) { ShowRecorder(recorder_->counters(), s); });
  alarms_.Look(board_.Get());
  // New settings would take a correction that waits away; it ends by itself.
  if (!correction_waits) TakeHangUp();
  upkeep_.Do(*desk_);
  const Requests::Served served = requests_.Serve(*desk_, correction_waits);
  if (served.any) ShowLot();
  ShowLock();
  keeper_.KeepAlarms(alarms_.TakeNews());
  PayDebts();
  return served.in_the_way_of;
}

// What the disk did not take and takes by now.
void Daemon::Impl::PayDebts() {
  const auto now = clock_.Now();
  if (now < debts_due_) return;
  debts_due_ = now + kPayPeriod;
  keeper_.TryAgain();
  board_.Update([this](CellSnapshot& s) { s.problem = keeper_.problem(); });
}

// Somebody wants the settings to be read again: between two parts, while nothing waits. Files that
// are not right change nothing.
void Daemon::Impl::TakeHangUp() {
  if (next_ || !g_hung_up.exchange(false)) return;
  notify_.Reloading();
  hal::Result<DaemonSettings> read = hal::Fail(hal::ErrorKind::kDevice, kShort);
  HasMemoryFor([&] {
    before_ = DaemonSettings{cell_, *own_part_};
    auto loaded = LoadDaemonSettings(options_);
    auto fits = CheckWatchdog({.watchdog = notify_.period()});
    if (loaded && !fits) loaded = hal::Fail(fits.error());
    read = std::move(loaded);
  });
  if (!read) {
    HasMemoryFor([&] { ReloadRefused(read.error().message); });
    notify_.Ready();
    return;
  }
  spdlog::info("SIGHUP: {} is read again", options_.config.string());
  next_ = std::move(*read);
}

void Daemon::Impl::ReloadRefused(const std::string& why) {
  alarms_.board().Begin(AlarmCode::kReloadRefused, why);
}

// A bender that broke a rule gets nothing before somebody has acknowledged, restarts or not.
void Daemon::Impl::ShowLock() {
  const std::string breach = desk_->Locked();
  if (breach.empty()) return;
  alarms_.board().Begin(IsOfJournal(breach) ? AlarmCode::kJournalDamaged : AlarmCode::kRulesBroken,
                        breach);
}

void Daemon::Impl::ShowLot() {
  const auto lot = keeper_.Lot(parts_.shown());
  board_.Update([&](CellSnapshot& s) {
    s.lot = {};
    alarms_.board().Set(AlarmCode::kLotHeld, lot && lot->held);
    if (!lot) return;
    s.lot.number = lot->number;
    s.lot.parts = lot->parts;
    s.lot.held = lot->held;
    if (lot->hypotheses.empty()) return;
    s.lot.temperament = pipeline::Name(lot->hypotheses.front().temperament);
  });
}

void Daemon::Impl::Viewed(const pipeline::LiveView& view) {
  const std::string line = ProgressLine(view, parts_.scanned().nominal_length_mm);
  notify_.Status(line);
  // Each bend once for everybody; every look for who asked for more.
  const bool news = view.program.bend_count() != bends_told_;
  bends_told_ = view.program.bend_count();
  spdlog::log(news ? spdlog::level::info : spdlog::level::debug, "scan: {}", line);
}

hal::Result<std::unique_ptr<Daemon::Impl>> Daemon::Begin(const DaemonOptions& options,
                                                         DaemonSettings settings) {
  spdlog::set_level(LevelOf(settings.cell.log_level));
  auto store = StateStore::Open(settings.cell.state_dir);
  if (!store) return hal::Fail(store.error());
  spdlog::info("{}: cell '{}', part '{}', {} bends, pipe radius {} mm, settings {}", kSoftware,
               settings.cell.name, settings.plan.part, settings.plan.nominal.bend_count(),
               settings.plan.pipe_radius_mm, settings.plan.config_digest);
  auto impl = std::make_unique<Impl>(options, std::move(settings), std::move(*store));
  if (auto ready = impl->Prepare(); !ready) return hal::Fail(ready.error());
  return impl;
}

hal::Result<std::unique_ptr<Daemon>> Daemon::Start(const DaemonOptions& options) {
  auto settings = LoadDaemonSettings(options);
  if (!settings) return hal::Fail(settings.error());
  auto impl = Begin(options, std::move(*settings));
  if (!impl) return hal::Fail(impl.error());
  return std::unique_ptr<Daemon>(new Daemon(options, std::move(*impl)));
}

Daemon::Daemon(const DaemonOptions& options, std::unique_ptr<Impl> impl)
    : options_(options), impl_(std::move(impl)) {}
Daemon::~Daemon() = default;

int Daemon::Run() {
  for (int ended = 0;;) {
    int code = hal::ExitCode(hal::ErrorKind::kDevice);
    // Its loop begins again where there was no memory for that.
    if (!HasMemoryFor([&] { code = impl_->Run(); }) && ++ended < kMostTries) {
      std::this_thread::sleep_for(kTryAgain);
      continue;
    }
    const std::optional<DaemonSettings> next = impl_->TakeNext();
    if (!next) return code;
    const DaemonSettings before = impl_->TakeBefore();
    impl_.reset();  // gives scanner, bender and state directory back
    auto begun = BeginAnew(*next);
    if (!begun) {
      const hal::Error why = std::move(begun.error());
      // The trouble may pass, want of memory above all; where it does not, systemd tries on.
      for (int tries = 0; !begun && tries < kMostTries; ++tries) {
        if (tries > 0) std::this_thread::sleep_for(kTryAgain);
        begun = BeginAnew(before);
      }
      if (begun) HasMemoryFor([&] { (*begun)->ReloadRefused(why.message); });
    }
    if (!begun) {
      spdlog::error("{}", begun.error().message);
      return hal::ExitCode(begun.error().kind);
    }
    impl_ = std::move(*begun);
  }
}

hal::Result<std::unique_ptr<Daemon::Impl>> Daemon::BeginAnew(const DaemonSettings& settings) const {
  hal::Result<std::unique_ptr<Impl>> begun = hal::Fail(hal::ErrorKind::kDevice, kShort);
  HasMemoryFor([&] { begun = Begin(options_, settings); });
  return begun;
}

void Daemon::RequestStop() { g_stop = true; }
void Daemon::NoteHangUp() { g_hung_up = true; }

}  // namespace bendloop::host
