// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/cell_loop.h"

#include <algorithm>
#include <utility>

#include "firmware-host/cell/service_times.h"
#include "firmware-host/console/version.h"
#include "firmware-host/workers/thread_workers.h"
#include "hal/scope_exit.h"

namespace bendloop::host {
namespace {

using namespace std::chrono_literals;

constexpr auto kReadTimeout = 20ms;
constexpr auto kPublishPeriod = 100ms;
constexpr auto kViewPeriod = 200ms;
// Coverage is looked at every so many profiles, never by time: a replay must end where the live
// scan ended.
constexpr std::uint64_t kCoveragePeriod = 64;
constexpr double kCoveredPart = 0.98;
constexpr auto kSilence = 2s;
// The longest that a step may take before it is taken for hung. The final fit is bounded by
// kMostPoints (part_plan.h) and takes less than a second on an idle machine.
constexpr auto kFitBound = 60s;
// People wait for no less.
constexpr auto kServePeriod = 200ms;
// For what the PLC says when a scan begins; the ring takes what comes meanwhile.
constexpr auto kOrdersPatience = 300ms;
constexpr const char* kOutOfMemory =
    "out of memory: see what else runs on this machine, and scan again";

double Milliseconds(std::chrono::nanoseconds t) { return static_cast<double>(t.count()) * 1e-6; }

// The nominal's length, all of its bends, and those as certain as the interlocks demand.
bool IsCovered(const pipeline::LiveView& view, const PartPlan& plan) {
  if (view.covered_mm < kCoveredPart * plan.nominal_length_mm) return false;
  const std::size_t bends = plan.nominal.bend_count();
  if (view.program.bend_count() != bends) return false;
  for (std::size_t i = 0; i < bends; ++i) {
    if (!(view.sigma.rows[i].angle_deg <= plan.interlocks.most_sigma.angle_deg)) return false;
  }
  return true;
}

}  // namespace

CellLoop::CellLoop(const PartPlan& plan, CellPorts ports, const CellLoopOptions& options)
    : plan_(std::make_shared<const PartPlan>(plan)),
      ports_(std::move(ports)),
      options_(options),
      scan_(options.scan),
      life_(*ports_.clock),
      waiting_(*ports_.desk, *ports_.clock, life_) {
  if (!options_.scan.is_live || !ports_.desk->has_bender()) return;
  // Each exchange of a commit is a step of its own.
  ports_.desk->set_progress([this, bound = ports_.desk->exchange_bound()] { life_.Expect(bound); });
  follower_.emplace(*ports_.desk, ports_.reporter, *ports_.board);
}

CellLoop::~CellLoop() {
  follower_.reset();
  Try("a correction that waited", [this] {
    GiveUpWaiting("the daemon was stopped while the correction waited for the bender");
  });
  ports_.desk->set_progress({});
}

// Tells that the loop lives, and the PLC what is new.
void CellLoop::Live() {
  Try("word to the PLC and to systemd", [this] {
    if (ports_.alive && life_.InTime()) ports_.alive();
  });
  if (follower_ && ports_.reporter && ports_.reporter->TakeChanged()) follower_->LookNow();
}

void CellLoop::Tend() {
  Live();
  Try("news of the bender", [this] { TakeBenderNews(); });
  Try("what people ask for, and upkeep", [this] { ServePeople(); });
}

void CellLoop::Watched(const std::function<void()>& work) {
  const hal::ScopeExit over([this] { life_.Rest(); });
  beside_.Do(work, kLoopPeriod, [this] { Live(); });
}

CellEnd CellLoop::Run(Acquisition& acquisition, ProfileRing& ring, const hal::SourceInfo& source) {
  scanner_ = source.model + (source.serial.empty() ? "" : " " + source.serial);
  source_ended_ = source_failed_ = false;
  // What a source that was opened anew sends belongs to no sweep of before.
  scan_.Rest();
  ports_.board->Update([&](CellSnapshot& s) {
    s.phase = CellPhase::kWaiting;
    s.scanner = scanner_;
  });
  CellEnd end = CellEnd::kStopped;
  while (!stop_.load(std::memory_order_relaxed)) {
    Live();
    Read(ring);
    UpdateAndWrite();
    Try("news of the bender", [this] { TakeBenderNews(); });
    Try("what people ask for, and upkeep", [this] { ServePeople(); });
    Try("a look at the scan", [&] { PublishCounters(acquisition, ring); });
    ring.Release();
    if (options_.max_parts > 0 && parts_ >= options_.max_parts && !waiting_) {
      end = CellEnd::kPartsDone;
      break;
    }
    if (source_failed_ || source_ended_) {
      end = source_failed_ ? CellEnd::kSourceFault : CellEnd::kSourceEnd;
      break;
    }
  }
  Try("the end of the scan", [this] {
    if (scan_.Break("the daemon stops") == ScanStep::kBroke) {
      DropScan({hal::ErrorKind::kDevice, scan_.reason()});
    }
  });
  published_ = {};
  Try("a look at the scan", [&] { PublishCounters(acquisition, ring); });
  return end;
}

void CellLoop::UpdateAndWrite() {
  const bool was_scanning = scan_.phase() == ScanPhase::kScanning;
  const bool has_memory = Try(was_scanning ? "a scan" : "the begin or end of a scan", [this] {
    Update();
    Write();
  });
  if (!has_memory) CutShort();
}

// What is at hand of a scan or part is given up. Each step may want memory, too.
void CellLoop::CutShort() {
  reconstruction_.reset();  // gives most of it back
  held_.clear();
  Try("the end of a scan", [this] { scan_.Break("out of memory"); });
  if (ports_.recorder) {
    Try("the end of a session", [this] { ports_.recorder->Finish({{"broken", "out of memory"}}); });
  }
  Try("telling of a part", [this] {
    if (is_untold_) TellFailed({hal::ErrorKind::kDevice, kOutOfMemory}, false);
  });
  if (std::exchange(is_untold_, false)) ++parts_;
  ports_.board->Update([](CellSnapshot& s) {
    s.phase = CellPhase::kWaiting;
    s.session.clear();
  });
}

void CellLoop::Read(ProfileRing& ring) { slot_ = ring.TakeWithin(kReadTimeout); }

void CellLoop::Update() {
  step_ = ScanStep::kNothing;
  WatchSweep();
  if (step_ != ScanStep::kNothing) return;
  // Everything that the scanner had sent is in: the PLC's word ends the scan.
  if (slot_ == nullptr && permit_.is_over() && scan_.phase() == ScanPhase::kScanning) {
    step_ = scan_.Complete();
    scan_.Rest();
    return;
  }
  if (slot_ == nullptr) return WatchSilence();
  heard_at_ = ports_.clock->Now();
  silent_ = false;
  if (slot_->dropped_before > 0) MarkGap();
  switch (slot_->kind) {
    case SlotKind::kProfile:
      step_ = scan_.Take(slot_->profile);
      break;
    case SlotKind::kEvent:
      step_ = scan_.Take(slot_->event);
      break;
    case SlotKind::kEnd:
      source_ended_ = true;
      step_ = scan_.TakeEnd();
      break;
    case SlotKind::kFault:
      source_failed_ = true;
      step_ = scan_.Break("the scanner went away in the middle of the scan: scan again");
      break;
  }
  if (step_ == ScanStep::kBegan) BeginScan();
  if (step_ != ScanStep::kNothing) GrowScan();
  if (step_ == ScanStep::kGrew && NominalIsCovered()) step_ = scan_.Complete();
}

// The ring was full: the session says so, and the scan counts it.
void CellLoop::MarkGap() {
  if (scan_.phase() != ScanPhase::kScanning) return;
  const std::int64_t t_ns =
      slot_->kind == SlotKind::kProfile ? slot_->profile.t_ns : slot_->event.t_ns;
  const hal::ScanEvent gap = GapEvent(t_ns, slot_->dropped_before, "the pipeline was too slow");
  scan_.Take(gap);
  if (ports_.recorder) ports_.recorder->Add(gap);
}

// Without events a part's scan is over when no points have come for so long, however its sweep went
// on after the tube was covered.
void CellLoop::WatchSweep() {
  if (!options_.scan.is_live || !options_.scan.ends_by_coverage) return;
  const bool is_profile = slot_ != nullptr && slot_->kind == SlotKind::kProfile;
  // A slot may have waited while the loop decided.
  const std::int64_t now_ns = is_profile ? slot_->arrived_ns : ports_.clock->Now().count();
  const bool has_points = is_profile && !slot_->profile.points.empty();
  if (now_ns - points_at_ns_ > options_.silence.count()) {
    scan_.Rest();
    if (!has_points && scan_.phase() == ScanPhase::kScanning) {
      step_ = scan_.Complete();
      scan_.Rest();
    }
  }
  if (has_points) points_at_ns_ = slot_->arrived_ns;
}

// A scanner that says nothing in the middle of a scan is reported at once and given up when a scan
// could no longer last.
void CellLoop::WatchSilence() {
  if (!options_.scan.is_live || scan_.phase() != ScanPhase::kScanning) return;
  const auto silence = ports_.clock->Now() - heard_at_;
  if (!silent_ && silence > kSilence) {
    silent_ = true;
    ports_.board->Update([](CellSnapshot& s) { ++s.silences; });
  }
  const double seconds = std::chrono::duration<double>(silence).count();
  if (seconds > options_.scan.max_seconds) {
    step_ =
        scan_.Break("the scanner said nothing for " + std::to_string(static_cast<int>(seconds)) +
                    " s in the middle of the scan: check it, and scan again");
  }
}

void CellLoop::Write() {
  if (step_ == ScanStep::kEnded) {
    if (held_.empty() && !permit_.may_run())
      held_ = "the PLC had said that no scan may run (orders.scan)";
    held_.empty() ? FinishScan() : HoldScan();
  }
  if (step_ == ScanStep::kBroke) DropScan({hal::ErrorKind::kDevice, scan_.reason()});
}

void CellLoop::TakeBenderNews() {
  if (!follower_) return;
  bool is_idle = false;
  if (const auto news = follower_->TakeNews()) {
    is_idle = news->facts && news->facts->state.mode == hal::BenderMode::kIdle;
    if (news->facts) HeardOrders(news->facts->state.orders);
    ports_.board->Update([&](CellSnapshot& s) {
      s.bender_state = news->facts ? Name(news->facts->state.mode) : news->problem;
      if (!news->facts) return;
      s.bender_sequence = news->facts->state.active_sequence;
      s.bender_parts_bent = news->facts->state.parts_bent;
    });
    if (ports_.bender_heard) ports_.bender_heard(*news);
    ports_.desk->TakeSettled(settled_);
    while (!settled_.empty()) {
      const SettledCommit& settled = settled_.front();
      if (ports_.commit_settled) {
        Watched([&] {
          life_.Expect(kDiskBound);
          ports_.commit_settled(settled);
        });
      }
      ports_.board->Update([&](CellSnapshot& s) {
        if (!s.last || s.last->session != settled.session) return;
        const bool is_active = settled.report.outcome == CommitOutcome::kCommitted;
        if (is_active) ++s.corrected;
        s.last->end = is_active ? "corrected" : "refused";
        s.last->reason = settled.report.reason;
      });
      settled_.pop_front();
    }
  }
  if (const auto told = waiting_.Tend(is_idle)) TellPart(*told, true);
}

void CellLoop::HeardOrders(const hal::PlcOrders& orders) {
  orders_ = orders;
  if (orders_.hold.value_or(false)) GiveUpWaiting("the PLC holds the cell");
  if (scan_.phase() == ScanPhase::kScanning) permit_.Heard(orders_);
}

// What the PLC says of the scan that begins: by a look that is asked for now, for what it said a
// quarter of a second ago may be of the tube before. One that does not answer is taken at its last
// word.
void CellLoop::TakeOrdersOfScan() {
  held_.clear();
  permit_ = {};
  if (!follower_) return;
  if (orders_ == hal::PlcOrders{}) {
    follower_->LookNow();
  } else {
    Watched([&] {
      life_.Expect(kOrdersPatience + kLoopPeriod);
      const auto now = follower_->LookWithin(kOrdersPatience);
      if (now && now->facts) orders_ = now->facts->state.orders;
    });
  }
  permit_.Begin(orders_);
  if (!ports_.part_of_scan) return;
  auto part = ports_.part_of_scan(orders_);
  if (part) {
    plan_ = std::move(*part);
  } else {
    held_ = part.error().message;
  }
}

void CellLoop::ServePeople() {
  if (!ports_.between_parts || waiting_.is_tried() || scan_.phase() == ScanPhase::kScanning) return;
  const auto now = ports_.clock->Now();
  if (now - served_ < kServePeriod) return;
  served_ = now;
  std::string wanted;
  Watched([&] {
    life_.Expect(2 * ports_.desk->exchange_bound() + kDiskBound);
    wanted = ports_.between_parts(static_cast<bool>(waiting_));
  });
  if (!wanted.empty()) GiveUpWaiting(wanted);
}

void CellLoop::GiveUpWaiting(const std::string& why) {
  if (!waiting_) return;
  std::optional<PartOutcome> told;
  Watched([&] {
    // An attempt on its way, then the ledger's note, which a look at the bender may keep waiting.
    life_.Expect(3 * ports_.desk->exchange_bound() + kDiskBound);
    told = waiting_.GiveUp(why);
  });
  if (told) TellPart(*told, true);
}

void CellLoop::BeginScan() {
  if (ports_.recorder && (reconstruction_ || !held_.empty())) ports_.recorder->Discard();
  // Which tube this is the ledger tells when the scan has ended: what was bent before now. The
  // nearer a look at the bender is to this moment, the surer that is.
  began_ns_ = ports_.desk->Now().boot_ns;
  is_untold_ = false;
  TakeOrdersOfScan();
  identity_ = ports_.identify();
  is_untold_ = true;
  if (orders_.identity) identity_.tube = *orders_.identity;
  live_ = {};
  view_due_ = ports_.clock->Now() + kViewPeriod;
  reconstruction_.reset();
  if (held_.empty()) reconstruction_.emplace(plan_->reconstruction, *ports_.clock);
  points_at_ns_ = ports_.clock->Now().count();
  if (ports_.recorder) {
    Recorder::Meta meta = {{"session", identity_.session}, {"part", plan_->part},
                           {"scanner", scanner_},          {"start", identity_.start},
                           {"software", kSoftware},        {"config_digest", plan_->config_digest}};
    if (!identity_.tube.empty()) meta["identity"] = identity_.tube;
    ports_.recorder->Begin(identity_.session, std::move(meta));
  }
  ports_.board->Update([&](CellSnapshot& s) {
    s.phase = CellPhase::kScanning;
    s.session = identity_.session;
    s.live = {};
    s.part = plan_->part;
    s.nominal_length_mm = plan_->nominal_length_mm;
  });
}

void CellLoop::GrowScan() {
  if (slot_->kind == SlotKind::kProfile) {
    last_arrival_ns_ = slot_->arrived_ns;
    if (reconstruction_) reconstruction_->Add(slot_->profile);
    if (ports_.recorder) ports_.recorder->Add(slot_->profile);
  } else if (slot_->kind == SlotKind::kEvent && ports_.recorder) {
    ports_.recorder->Add(slot_->event);
  }
}

bool CellLoop::NominalIsCovered() {
  if (!options_.scan.ends_by_coverage || scan_.profiles() % kCoveragePeriod != 0) return false;
  return reconstruction_ && IsCovered(reconstruction_->View(), *plan_);
}

// A scan that is over and that nothing is made of: recorded, and told why.
void CellLoop::HoldScan() {
  reconstruction_.reset();
  if (ports_.recorder) ports_.recorder->Finish({{"broken", held_}});
  TellFailed({hal::ErrorKind::kRefused, std::exchange(held_, {})}, true);
}

// Why nothing was measured. `is_part`: its scan came to its end.
void CellLoop::TellFailed(hal::Error error, bool is_part) {
  LastPart last{identity_.session, "not measured", "", error.message};
  is_untold_ = false;
  ++parts_;
  ports_.board->Update([&](CellSnapshot& s) {
    if (is_part) ++s.parts;
    ++s.failed_scans;
    s.session.clear();
    s.last = std::move(last);
  });
  Watched([&] {
    life_.Expect(kDiskBound);
    ports_.scan_failed({identity_, std::move(error), scan_.profiles()});
  });
  ports_.board->Update([](CellSnapshot& s) { s.phase = CellPhase::kWaiting; });
}

// The loop waits for it and tells that it lives; each step is bounded by itself.
void CellLoop::FinishScan() {
  const auto ended = ports_.clock->Now();
  MeasuredPart part;
  part.scan = {scan_.profiles(), scan_.lost_profiles(), began_ns_, ports_.recorded_end};
  const Moment now = ports_.desk->Now();
  if (options_.scan.is_live) part.scan.ended = now;
  part.identity = identity_;
  part.recorded = ports_.recorded;
  part.may_wait = follower_.has_value();
  ports_.board->Update([](CellSnapshot& s) { s.phase = CellPhase::kDeciding; });
  hal::Result<pipeline::Measurement> measurement;
  const bool has_memory = Try("the fit", [&] {
    Watched([&] {
      life_.Expect(kFitBound);
      ThreadWorkers workers(ProcessorCount());
      measurement = reconstruction_->Finish(&workers);
    });
  });
  const auto measured = ports_.clock->Now();
  reconstruction_.reset();
  if (!has_memory) measurement = hal::Fail(hal::ErrorKind::kDevice, kOutOfMemory);
  if (!measurement) {
    if (ports_.recorder) ports_.recorder->Finish({});
    return TellFailed(measurement.error(), true);
  }
  part.measurement = std::move(*measurement);
  if (plan_->corrects && ports_.desk->has_bender()) {
    ports_.board->Update([](CellSnapshot& s) { s.phase = CellPhase::kCommitting; });
  }
  PartOutcome outcome = Decide(std::move(part));
  ++parts_;
  const auto decided = ports_.clock->Now();
  // Not before: closing a session keeps the disk busy, and the commit's journal waits for it, too.
  if (ports_.recorder) {
    Try("the end of a session", [&] {
      Recorder::Meta meta = {{kContextKey, WriteRunContext(outcome.context)}};
      if (options_.scan.is_live) meta[kEndKey] = UtcText(now.unix_ms);
      ports_.recorder->Finish(meta);
    });
  }
  const double ms = Milliseconds(decided - ended);
  if (options_.scan.is_live) {
    const std::chrono::nanoseconds arrived(last_arrival_ns_);
    outcome.latency = {Milliseconds(measured - arrived), Milliseconds(decided - arrived)};
  }
  waiting_.set_latency(outcome.latency);
  ports_.board->Update([&](CellSnapshot& s) {
    s.last_decision_ms = ms;
    s.peak_decision_ms = std::max(s.peak_decision_ms, ms);
  });
  TellPart(outcome, false);
}

PartOutcome CellLoop::Decide(MeasuredPart part) {
  // The correction of this part contains what that one taught.
  GiveUpWaiting("the next part, " + part.identity.session + ", was measured first");
  if (ports_.lot) part.lot = ports_.lot();
  PartOutcome outcome;
  Watched([&] {
    life_.Expect(2 * ports_.desk->exchange_bound() + kDiskBound);
    outcome = DecidePart(*plan_, part, *ports_.desk);
  });
  waiting_.Take(std::move(part), outcome, plan_);
  return outcome;
}

// `again`: it was told before that the part waits.
void CellLoop::TellPart(const PartOutcome& outcome, bool again) {
  const PartEnd what = outcome.end;
  if (!again) is_untold_ = false;
  // First: whatever there is no memory for below, it is kept.
  Try("what is kept of a part", [&] {
    Watched([&] {
      life_.Expect(kDiskBound);
      ports_.part_done(outcome);
    });
  });
  LastPart last{outcome.result.session, Name(what),
                std::string(pipeline::Name(outcome.result.inspection->verdict)),
                outcome.reasons.empty() ? "" : outcome.reasons.front()};
  if (const auto& correction = outcome.result.correction) {
    last.notices = correction->notices;
    if (!correction->forecast.rows.empty()) last.forecast = correction->forecast.part;
  }
  last.furthest_pass = outcome.furthest_pass;
  ports_.board->Update([&](CellSnapshot& s) {
    if (what == PartEnd::kCorrected) ++s.corrected;
    if (what == PartEnd::kRefused || what == PartEnd::kLinkDown) ++s.refused;
    if (what == PartEnd::kRepeat) ++s.repeats;
    s.last = last;
    if (again) return;
    ++s.parts;
    s.phase = CellPhase::kWaiting;
    s.session.clear();
    s.last_lra_ms = outcome.latency.lra_ms;
    s.peak_lra_ms = std::max(s.peak_lra_ms, outcome.latency.lra_ms);
    s.last_end_ms = outcome.latency.end_ms;
    s.peak_end_ms = std::max(s.peak_end_ms, outcome.latency.end_ms);
  });
}

void CellLoop::DropScan(hal::Error error) {
  reconstruction_.reset();
  held_.clear();
  if (ports_.recorder) {
    // A scan that broke off late is worth keeping: it shows what went wrong.
    if (scan_.profiles() < options_.scan.min_profiles) {
      ports_.recorder->Discard();
    } else {
      ports_.recorder->Finish({{"broken", error.message}});
    }
  }
  TellFailed(std::move(error), false);
}

void CellLoop::PublishCounters(const Acquisition& acquisition, const ProfileRing& ring) {
  const auto now = ports_.clock->Now();
  if (published_.count() != 0 && now - published_ < kPublishPeriod) return;
  published_ = now;
  if (reconstruction_ && now >= view_due_ && 4 * ring.Filled() < ring.capacity()) {
    // Outside of the board's lock, and never more than a tenth of the loop's time: looking at the
    // scan must not make it late.
    live_ = reconstruction_->View();
    const auto taken = ports_.clock->Now() - now;
    view_due_ = now + taken + std::max<std::chrono::nanoseconds>(kViewPeriod, 9 * taken);
    if (ports_.viewed) ports_.viewed(live_);
  }
  const AcquisitionCounters& counters = acquisition.counters();
  ports_.board->Update([&](CellSnapshot& s) {
    ShowAcquisition(counters, ring, s);
    if (reconstruction_) {
      s.live = live_;
      s.live.profiles = scan_.profiles();
      s.live.points = scan_.points();
    }
    if (ports_.recorder) ShowRecorder(ports_.recorder->counters(), s);
  });
}

}  // namespace bendloop::host
