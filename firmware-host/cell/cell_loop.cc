// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/cell_loop.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "firmware-host/cell/version.h"
#include "firmware-host/workers/thread_workers.h"

namespace bendloop::host {
namespace {

using namespace std::chrono_literals;

constexpr auto kReadTimeout = 20ms;
constexpr auto kPublishPeriod = 100ms;
constexpr auto kAskPeriod = 1s;
constexpr auto kViewPeriod = 200ms;
// Coverage is looked at every so many profiles, never by time: a replay must end where the live
// scan ended.
constexpr std::uint64_t kCoveragePeriod = 64;
constexpr double kCoveredPart = 0.98;
constexpr auto kSilence = 2s;

double Milliseconds(std::chrono::nanoseconds t) { return static_cast<double>(t.count()) * 1e-6; }

const char* Word(hal::BenderMode mode) {
  switch (mode) {
    case hal::BenderMode::kNotReady:
      return "not ready";
    case hal::BenderMode::kIdle:
      return "idle";
    case hal::BenderMode::kBending:
      return "bending";
    case hal::BenderMode::kFault:
      break;
  }
  return "fault";
}

const char* Word(PartEnd end) {
  switch (end) {
    case PartEnd::kCorrected:
      return "corrected";
    case PartEnd::kUnchanged:
      return "unchanged";
    case PartEnd::kRefused:
      return "refused";
    case PartEnd::kLinkDown:
      break;
  }
  return "link down";
}

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
    : plan_(plan), ports_(std::move(ports)), options_(options), scan_(options.scan) {}

CellEnd CellLoop::Run(Acquisition& acquisition, ProfileRing& ring, const hal::SourceInfo& source) {
  scanner_ = source.model + (source.serial.empty() ? "" : " " + source.serial);
  source_ended_ = source_failed_ = false;
  ports_.board->Update([&](CellSnapshot& s) {
    s.phase = CellPhase::kWaiting;
    s.scanner = scanner_;
  });
  CellEnd end = CellEnd::kStopped;
  while (!stop_.load(std::memory_order_relaxed)) {
    if (ports_.alive) ports_.alive();
    Read(ring);
    Update();
    Write();
    AskBender();
    PublishCounters(acquisition, ring);
    ring.Release();
    if (options_.max_parts > 0 && parts_ >= options_.max_parts) {
      end = CellEnd::kPartsDone;
      break;
    }
    if (source_failed_ || source_ended_) {
      end = source_failed_ ? CellEnd::kSourceFault : CellEnd::kSourceEnd;
      break;
    }
  }
  if (scan_.Break("the daemon stops") == ScanStep::kBroke) {
    DropScan({hal::ErrorKind::kDevice, scan_.reason()});
  }
  published_ = {};
  PublishCounters(acquisition, ring);
  return end;
}

void CellLoop::Read(ProfileRing& ring) { slot_ = ring.TakeWithin(kReadTimeout); }

void CellLoop::Update() {
  step_ = ScanStep::kNothing;
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
  if (step_ == ScanStep::kEnded) FinishScan();
  if (step_ == ScanStep::kBroke) DropScan({hal::ErrorKind::kDevice, scan_.reason()});
}

void CellLoop::AskBender() {
  if (!options_.scan.is_live || !ports_.desk->has_bender()) return;
  if (asked_.valid()) {
    if (asked_.wait_for(0s) != std::future_status::ready) return;
    const BenderReading heard = asked_.get();
    ports_.board->Update([&](CellSnapshot& s) {
      s.bender_state = heard.facts ? Word(heard.facts->state.mode) : heard.problem;
      if (heard.facts) s.bender_sequence = heard.facts->state.active_sequence;
    });
    if (ports_.bender_heard) ports_.bender_heard(heard);
  }
  if (scan_.phase() != ScanPhase::kWaiting || base_.valid()) return;
  const auto now = ports_.clock->Now();
  if (asked_at_.count() != 0 && now - asked_at_ < kAskPeriod) return;
  asked_at_ = now;
  // Beside the loop: a bender that is slow to answer must not cost profiles.
  asked_ = std::async(std::launch::async, [desk = ports_.desk] { return desk->Read(); });
}

void CellLoop::BeginScan() {
  if (base_.valid()) base_.wait();  // of a scan that was begun again
  if (ports_.recorder && reconstruction_) ports_.recorder->Discard();
  identity_ = ports_.identify();
  live_ = {};
  view_due_ = ports_.clock->Now() + kViewPeriod;
  reconstruction_.emplace(plan_.reconstruction, *ports_.clock);
  // The program that the bender holds now is the one that bent this part. It is asked beside the
  // scan: a slow bender must not cost profiles.
  base_ = std::async(std::launch::async, [this, lot = ports_.lot ? ports_.lot() : std::nullopt,
                                          asked = std::move(asked_)]() mutable {
    if (asked.valid()) asked.wait();
    if (ports_.recorded) return *ports_.recorded;
    RunContext base;
    base.lot = lot;
    if (BenderReading now = ports_.desk->Read(); now.facts) {
      base.bent_with = std::move(now.facts->active);
    }
    base.last_sequence = ports_.desk->LastSequence();
    return base;
  });
  if (ports_.recorder) {
    ports_.recorder->Begin(identity_.session, {{"session", identity_.session},
                                               {"part", plan_.part},
                                               {"scanner", scanner_},
                                               {"start", identity_.start},
                                               {"software", kSoftware},
                                               {"config_digest", plan_.config_digest}});
  }
  ports_.board->Update([&](CellSnapshot& s) {
    s.phase = CellPhase::kScanning;
    s.session = identity_.session;
    s.live = {};
    s.nominal_length_mm = plan_.nominal_length_mm;
  });
}

void CellLoop::GrowScan() {
  if (slot_->kind == SlotKind::kProfile) {
    last_arrival_ns_ = slot_->arrived_ns;
    reconstruction_->Add(slot_->profile);
    if (ports_.recorder) ports_.recorder->Add(slot_->profile);
  } else if (slot_->kind == SlotKind::kEvent && ports_.recorder) {
    ports_.recorder->Add(slot_->event);
  }
}

bool CellLoop::NominalIsCovered() {
  if (!options_.ends_by_coverage || scan_.profiles() % kCoveragePeriod != 0) return false;
  return IsCovered(reconstruction_->View(), plan_);
}

void CellLoop::FinishScan() {
  const auto ended = ports_.clock->Now();
  ports_.board->Update([](CellSnapshot& s) { s.phase = CellPhase::kDeciding; });
  const RunContext base = base_.get();
  ThreadWorkers workers(ProcessorCount());
  auto measurement = reconstruction_->Finish(&workers);
  const auto measured = ports_.clock->Now();
  reconstruction_.reset();
  ++parts_;
  if (!measurement) {
    if (ports_.recorder) ports_.recorder->Finish({{kContextKey, WriteRunContext(base)}});
    ports_.board->Update([&](CellSnapshot& s) {
      ++s.parts;
      ++s.failed_scans;
      s.phase = CellPhase::kWaiting;
      s.session.clear();
      s.last = LastPart{identity_.session, "not measured", "", measurement.error().message};
    });
    ports_.scan_failed({identity_, measurement.error()});
    return;
  }
  ScanFacts facts{scan_.profiles(), scan_.lost_profiles(), 0};
  if (options_.scan.is_live) {
    facts.age_s = std::chrono::duration<double>(ports_.clock->Now() - ended).count();
  }
  PartOutcome outcome =
      DecidePart(plan_, identity_, facts, base, std::move(*measurement), *ports_.desk);
  const auto decided = ports_.clock->Now();
  // Not before: closing a session keeps the disk busy, and the commit's journal waits for it, too.
  if (ports_.recorder) ports_.recorder->Finish({{kContextKey, WriteRunContext(base)}});
  const double ms = Milliseconds(decided - ended);
  if (options_.scan.is_live) {
    const std::chrono::nanoseconds arrived(last_arrival_ns_);
    outcome.latency = {Milliseconds(measured - arrived), Milliseconds(decided - arrived)};
  }
  const PartEnd what = outcome.end;
  const PartLatency latency = outcome.latency;
  const LastPart last{identity_.session, Word(what),
                      std::string(pipeline::Name(outcome.result.inspection->verdict)),
                      outcome.reasons.empty() ? "" : outcome.reasons.front()};
  ports_.part_done(std::move(outcome));
  ports_.board->Update([&](CellSnapshot& s) {
    ++s.parts;
    if (what == PartEnd::kCorrected) ++s.corrected;
    if (what == PartEnd::kRefused || what == PartEnd::kLinkDown) ++s.refused;
    s.phase = CellPhase::kWaiting;
    s.session.clear();
    s.last_lra_ms = latency.lra_ms;
    s.peak_lra_ms = std::max(s.peak_lra_ms, latency.lra_ms);
    s.last_end_ms = latency.end_ms;
    s.peak_end_ms = std::max(s.peak_end_ms, latency.end_ms);
    s.last_decision_ms = ms;
    s.peak_decision_ms = std::max(s.peak_decision_ms, ms);
    s.last = last;
  });
}

void CellLoop::DropScan(hal::Error error) {
  if (base_.valid()) base_.wait();
  base_ = {};
  reconstruction_.reset();
  if (ports_.recorder) {
    // A scan that broke off late is worth keeping: it shows what went wrong.
    if (scan_.profiles() < options_.scan.min_profiles) {
      ports_.recorder->Discard();
    } else {
      ports_.recorder->Finish({{"broken", error.message}});
    }
  }
  ++parts_;
  ports_.board->Update([&](CellSnapshot& s) {
    ++s.failed_scans;
    s.phase = CellPhase::kWaiting;
    s.session.clear();
    s.last = LastPart{identity_.session, "not measured", "", error.message};
  });
  ports_.scan_failed({identity_, std::move(error)});
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
    s.profiles = counters.profiles;
    s.points = counters.points;
    s.dropped_profiles = counters.dropped_profiles;
    s.missing_profiles = counters.missing_profiles;
    s.dropped_events = counters.dropped_events;
    s.repeated_profiles = counters.repeated_profiles;
    s.reordered_profiles = counters.reordered_profiles;
    s.queue_now = ring.Filled();
    s.queue_peak = counters.queue_peak;
    s.queue_capacity = ring.capacity();
    s.lateness_last_ms = static_cast<double>(counters.lateness_last_ns) * 1e-6;
    s.lateness_peak_ms = static_cast<double>(counters.lateness_peak_ns) * 1e-6;
    const double drift_ppm = counters.clock_drift_ppm;
    s.clock_drift_ppm = std::isnan(drift_ppm) ? std::nullopt : std::optional<double>(drift_ppm);
    if (reconstruction_) {
      s.live = live_;
      s.live.profiles = scan_.profiles();
      s.live.points = scan_.points();
    }
    if (ports_.recorder) {
      const RecorderCounters recorder = ports_.recorder->counters();
      s.recorded_sessions = recorder.sessions;
      s.recorder_dropped = recorder.dropped_profiles;
      s.recorder_dropped_events = recorder.dropped_events;
      s.recorder_dropped_sessions = recorder.dropped_sessions;
      s.recorder_error = recorder.last_error;
      s.recorder_waiting_points = recorder.queued_points;
      s.removed_sessions = recorder.removed_sessions;
      s.disk_used_mb = recorder.sessions_bytes >> 20;
      s.disk_free_mb = recorder.free_bytes >> 20;
    }
  });
}

}  // namespace bendloop::host
