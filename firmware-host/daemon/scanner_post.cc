// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/scanner_post.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <future>

#include "firmware-host/cell/live_source.h"
#include "firmware-host/cell/service_times.h"
#include "firmware-host/workers/want_of_memory.h"

namespace bendloop::host {
namespace {

void LogCounters(const AcquisitionCounters& counters, const ProfileRing& ring) {
  spdlog::info("scanner: {} profiles, {} dropped, {} missing, ring peak {} of {}",
               counters.profiles.load(), counters.dropped_profiles.load(),
               counters.missing_profiles.load(), counters.queue_peak.load(), ring.capacity());
  if (const double ppm = counters.clock_drift_ppm; !std::isnan(ppm)) {
    spdlog::info("scanner: its clock runs {:.1f} ppm {}", std::abs(ppm), ppm < 0 ? "slow" : "fast");
  }
}

}  // namespace

RealtimePolicy RealtimeOf(const config::RealtimeConfig& from) {
  RealtimePolicy policy;
  policy.enabled = true;
  policy.required = from.mode == config::RealtimeMode::kRequired;
  policy.priority = from.priority;
  policy.cpu = from.cpu.value_or(-1);
  return policy;
}

bool ScannerPost::Serve(CellLoop& loop) {
  bool goes_on = true;
  if (HasMemoryFor([&] { goes_on = ServeOne(loop); })) return goes_on;
  board_.OutOfMemory("the scanner's connection");
  HasMemoryFor([this] { IsAway(kNoMemory); });
  return true;
}

bool ScannerPost::ServeOne(CellLoop& loop) {
  AcquisitionOptions options;
  options.realtime = RealtimeOf(cell_.realtime);
  auto source = MakeSource(cell_.scanner, clock_, options.realtime);
  if (!source) {
    spdlog::error("scanner: {}", source.error().message);
    return GiveUp(source.error());
  }
  // Beside the loop: a scanner that does not answer for seconds must not keep the bender waiting,
  // nor the watchdog.
  auto opening = std::async(std::launch::async, [&source] { return (*source)->Open(); });
  while (opening.wait_for(kLoopPeriod) != std::future_status::ready) loop.Tend();
  const auto info = opening.get();
  if (!info) return IsAway(info.error().message);
  ProfileRing ring(cell_.scanner.queue_profiles, info->max_points);
  Acquisition acquisition(**source, *info, ring, clock_, options);
  if (auto started = acquisition.Start(); !started) {
    const bool is_kernels = started.error().message.rfind("[realtime]", 0) == 0;
    if (!options.realtime.required || !is_kernels) return IsAway(started.error().message);
    spdlog::error("{}", started.error().message);
    return GiveUp(started.error());
  }
  IsThere(*info, acquisition, ring);
  const CellEnd end = loop.Run(acquisition, ring, *info);
  acquisition.Stop();
  LogCounters(acquisition.counters(), ring);
  const std::string remarks = (*source)->Remarks();
  if (!remarks.empty()) alarms_.Begin(AlarmCode::kScannerRemarks, remarks);
  return end == CellEnd::kSourceFault && IsAway(acquisition.fault().message);
}

void ScannerPost::IsThere(const hal::SourceInfo& info, const Acquisition& acquisition,
                          const ProfileRing& ring) {
  spdlog::info("scanner: {} {}, firmware {}, up to {} points a profile, ring of {} profiles",
               info.model, info.serial, info.firmware, info.max_points, ring.capacity());
  if (!acquisition.realtime_note().empty()) {
    alarms_.Begin(AlarmCode::kNoRealtime, acquisition.realtime_note());
  }
  alarms_.End(AlarmCode::kScannerAway);
  problem_.clear();
  retry_ = kFirstRetry;
  notify_.Status("scanner connected, waiting for a scan");
}

bool ScannerPost::IsAway(const std::string& why) {
  // Once for each reason: an unplugged scanner must not fill the log.
  if (why != problem_) {
    spdlog::warn("no scanner: {}; trying again every {} s at most", why,
                 kLongestRetry.count() / 1000);
  }
  alarms_.Begin(AlarmCode::kScannerAway, why);
  problem_ = why;
  notify_.Status("no scanner: " + why);
  board_.Update([&](CellSnapshot& s) {
    s.phase = CellPhase::kNoScanner;
    s.scanner = why;
  });
  return true;
}

bool ScannerPost::GiveUp(const hal::Error& error) {
  exit_code_ = hal::ExitCode(error.kind);
  return false;
}

void ScannerPost::WaitForRetry(CellLoop& loop, const std::function<bool()>& ends) {
  const auto until = clock_.Now() + retry_;
  while (!ends() && clock_.Now() < until) {
    loop.Tend();
    clock_.SleepUntil(std::min(until, clock_.Now() + std::chrono::nanoseconds(kLoopPeriod)));
  }
  retry_ = std::min<std::chrono::milliseconds>(retry_ * 2, kLongestRetry);
}

}  // namespace bendloop::host
