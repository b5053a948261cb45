// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/scan_state.h"

#include <algorithm>
#include <charconv>
#include <utility>

#include "hal/saturating.h"

namespace bendloop::host {
namespace {

// Numbers further apart are not looked up: four hours of scan. They count as a gap as wide as they
// say, so that no repeat among them hides it.
constexpr std::uint64_t kMostNumbers = 1u << 24;

constexpr std::string_view kLost = "lost ";

}  // namespace

hal::ScanEvent GapEvent(std::int64_t t_ns, std::uint64_t profiles, std::string_view why) {
  hal::ScanEvent event;
  event.kind = hal::ScanEventKind::kGap;
  event.t_ns = hal::SaturatingDifference(t_ns, 1);  // events are sorted by time
  event.set_detail(std::string(kLost) + std::to_string(profiles) +
                   " profiles: " + std::string(why));
  return event;
}

void ScanState::Begin() {
  phase_ = ScanPhase::kScanning;
  profiles_ = 0;
  points_ = 0;
  repeated_ = 0;
  lost_at_end_ = 0;
  seen_.clear();
  first_t_ns_.reset();
  reason_.clear();
}

// Only events tell a live sweep's end; without them it goes on until it falls silent.
void ScanState::End() {
  const bool goes_on = rules_.is_live && rules_.ends_by_coverage;
  phase_ = goes_on ? ScanPhase::kAfter : ScanPhase::kWaiting;
}

bool ScanState::IsNew(std::uint64_t sequence) {
  if (profiles_ == 0) seen_from_ = sequence;
  if (sequence < seen_from_) {
    const std::uint64_t below = seen_from_ - sequence;
    const std::uint64_t room = kMostNumbers - seen_.size();
    if (below > room) return true;
    // At least as many again: numbers that count down must not copy the list at each step.
    const std::uint64_t more =
        std::min({std::max<std::uint64_t>(below, seen_.size()), room, seen_from_});
    seen_.insert(seen_.begin(), more, false);
    seen_from_ -= more;
  }
  const std::uint64_t at = sequence - seen_from_;
  if (at >= kMostNumbers) return true;
  if (at >= seen_.size()) seen_.resize(at + 1);
  if (seen_[at]) return false;
  seen_[at] = true;
  return true;
}

ScanStep ScanState::Take(const hal::LaserProfile& profile) {
  bool began = false;
  if (phase_ == ScanPhase::kAfter) {
    ++ignored_;
    return ScanStep::kNothing;
  }
  if (phase_ == ScanPhase::kWaiting) {
    // A scanner that looks at nothing has not begun.
    const bool empty = rules_.ends_by_coverage && profile.points.empty();
    if (rules_.is_live && (rules_.starts_by_event || empty)) {
      ++ignored_;
      return ScanStep::kNothing;
    }
    Begin();
    began = true;
  }
  if (!IsNew(profile.sequence)) {
    ++repeated_;
    return ScanStep::kNothing;
  }
  lost_at_end_ = 0;  // the numbers tell
  if (profiles_ == 0) first_sequence_ = last_sequence_ = profile.sequence;
  first_sequence_ = std::min(first_sequence_, profile.sequence);
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
    case hal::ScanEventKind::kScanEnd: {
      const ScanStep step = scanning ? Complete() : ScanStep::kNothing;
      Rest();
      return step;
    }
    case hal::ScanEventKind::kFault:
      if (!scanning) return ScanStep::kNothing;
      return Break("the scanner reports a fault: " + std::string(event.detail()));
    case hal::ScanEventKind::kGap:
      if (scanning && event.detail().substr(0, kLost.size()) == kLost) {
        const std::string_view count = event.detail().substr(kLost.size());
        std::uint32_t lost = 0;
        std::from_chars(count.data(), count.data() + count.size(), lost);
        lost_at_end_ += lost;
      }
      return scanning ? ScanStep::kGrew : ScanStep::kNothing;
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
  End();
  return ScanStep::kEnded;
}

ScanStep ScanState::Break(std::string reason) {
  if (phase_ != ScanPhase::kScanning) return ScanStep::kNothing;
  End();
  reason_ = std::move(reason);
  return ScanStep::kBroke;
}

std::uint64_t ScanState::lost_profiles() const {
  if (profiles_ == 0) return lost_at_end_;
  const std::uint64_t others = last_sequence_ - first_sequence_;  // numbers but one
  const std::uint64_t lost = others >= profiles_ ? others - (profiles_ - 1) : 0;
  return lost + std::min(lost_at_end_, UINT64_MAX - lost);
}

}  // namespace bendloop::host
