// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/scan_state.h"

#include <algorithm>
#include <utility>

namespace bendloop::host {

void ScanState::Begin() {
  phase_ = ScanPhase::kScanning;
  profiles_ = 0;
  points_ = 0;
  first_t_ns_.reset();
  reason_.clear();
}

ScanStep ScanState::Take(const hal::LaserProfile& profile) {
  bool began = false;
  if (phase_ == ScanPhase::kWaiting) {
    if (rules_.is_live && rules_.starts_by_event) {
      ++ignored_;
      return ScanStep::kNothing;
    }
    Begin();
    began = true;
  }
  if (profiles_ == 0) first_sequence_ = last_sequence_ = profile.sequence;
  last_sequence_ = std::max(last_sequence_, profile.sequence);
  if (!first_t_ns_) first_t_ns_ = profile.t_ns;
  ++profiles_;
  points_ += profile.points.size();
  // Unsigned: times from a damaged recording must not overflow.
  const std::uint64_t ns =
      static_cast<std::uint64_t>(profile.t_ns) - static_cast<std::uint64_t>(*first_t_ns_);
  if (profile.t_ns > *first_t_ns_ && static_cast<double>(ns) > rules_.max_seconds * 1e9) {
    return Break("the scan runs for more than " +
                 std::to_string(static_cast<int>(rules_.max_seconds)) +
                 " s: end it at the scanner, or raise [scan] max_seconds");
  }
  return began ? ScanStep::kBegan : ScanStep::kGrew;
}

ScanStep ScanState::Take(const hal::ScanEvent& event) {
  const bool scanning = phase_ == ScanPhase::kScanning;
  switch (event.kind) {
    case hal::ScanEventKind::kScanStart:
      // A start within a scan: the operator began again, and what came before is no whole part.
      Begin();
      return ScanStep::kBegan;
    case hal::ScanEventKind::kScanEnd:
      return scanning ? Complete() : ScanStep::kNothing;
    case hal::ScanEventKind::kFault:
      if (!scanning) return ScanStep::kNothing;
      return Break("the scanner reports a fault: " + std::string(event.detail()));
    default:
      return scanning ? ScanStep::kGrew : ScanStep::kNothing;
  }
}

ScanStep ScanState::TakeEnd() {
  return phase_ == ScanPhase::kScanning ? Complete() : ScanStep::kNothing;
}

ScanStep ScanState::Complete() {
  if (profiles_ < rules_.min_profiles) {
    return Break("the scan has " + std::to_string(profiles_) + " profiles, expected at least " +
                 std::to_string(rules_.min_profiles) + ": scan the whole tube");
  }
  phase_ = ScanPhase::kWaiting;
  return ScanStep::kEnded;
}

ScanStep ScanState::Break(std::string reason) {
  if (phase_ == ScanPhase::kWaiting) return ScanStep::kNothing;
  phase_ = ScanPhase::kWaiting;
  reason_ = std::move(reason);
  return ScanStep::kBroke;
}

std::uint64_t ScanState::lost_profiles() const {
  if (profiles_ == 0) return 0;
  const std::uint64_t numbers = last_sequence_ - first_sequence_ + 1;
  return numbers > profiles_ ? numbers - profiles_ : 0;
}

}  // namespace bendloop::host
