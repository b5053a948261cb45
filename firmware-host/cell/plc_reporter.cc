// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/plc_reporter.h"

#include <algorithm>
#include <utility>

namespace bendloop::host {
namespace {

using namespace std::chrono_literals;

// drivers/README.md promises it to the PLC.
constexpr std::chrono::nanoseconds kBeat = 500ms;
constexpr std::chrono::nanoseconds kFirstPause = 1s;
constexpr std::chrono::nanoseconds kLongestPause = 60s;

}  // namespace

void PlcReporter::Set(const hal::CellReport& report) {
  const std::lock_guard lock(mutex_);
  if (report_ == report) return;
  report_ = report;
  changed_ = due_ = true;
}

bool PlcReporter::TakeChanged() {
  const std::lock_guard lock(mutex_);
  return std::exchange(changed_, false);
}

std::string PlcReporter::problem() const {
  const std::lock_guard lock(mutex_);
  return problem_;
}

void PlcReporter::Write(BenderDesk& desk) {
  std::unique_lock lock(mutex_);
  const auto now = clock_.Now();
  const bool is_beat = now - beat_at_ >= kBeat;
  if (!report_ || now < again_at_ || (!due_ && !is_beat)) return;
  hal::CellReport report = *report_;
  if (is_beat) {
    beat_at_ = now;
    ++heartbeat_;
  }
  report.heartbeat = heartbeat_;
  due_ = false;
  lock.unlock();
  const auto written = desk.Report(report);
  lock.lock();
  problem_ = written ? "" : written.error().message;
  pause_ = written ? 0s : std::clamp(2 * pause_, kFirstPause, kLongestPause);
  again_at_ = clock_.Now() + pause_;
  due_ = due_ || !written;
}

}  // namespace bendloop::host
