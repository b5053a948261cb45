// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "hal/laser_profile.h"
#include "hal/scan_event.h"

namespace bendloop::host {

struct ScanRules {
  bool is_live = true;
  bool starts_by_event = true;  // live: profiles before scan_start belong to no scan
  bool ends_by_coverage = false;
  double max_seconds = 120;  // by the profiles' own times
  std::uint32_t min_profiles = 20;
};

enum class ScanPhase : std::uint8_t {
  kWaiting,
  kScanning,
  kAfter,  // of a scan that coverage ended, or that broke: its sweep goes on and adds nothing
};

// What a slot means for the scan.
enum class ScanStep : std::uint8_t {
  kNothing,  // does not belong to a scan
  kBegan,    // a scan starts with this slot
  kGrew,     // the slot belongs to the scan that runs
  kEnded,    // the scan is complete
  kBroke,    // the scan is over and worth nothing: reason()
};

// Says that so many profiles are gone before what came at `t_ns`; a session keeps it, and a replay
// counts it too.
hal::ScanEvent GapEvent(std::int64_t t_ns, std::uint64_t profiles, std::string_view why);

// Which profiles make one scan, from the scanner's events: scan_start begins, scan_end ends, the
// end of a recording ends as well. Knows no clock, so that a recording is cut as the live scan was.
class ScanState {
 public:
  explicit ScanState(const ScanRules& rules) : rules_(rules) {}

  ScanStep Take(const hal::LaserProfile& profile);
  ScanStep Take(const hal::ScanEvent& event);
  // The recording is over.
  ScanStep TakeEnd();
  // The nominal has been covered: a scan without scan_end is complete.
  ScanStep Complete();
  // No points for longer than a pause within a part: whatever comes is of another one.
  void Rest() {
    if (phase_ == ScanPhase::kAfter) phase_ = ScanPhase::kWaiting;
  }
  // The scanner or the daemon went away.
  ScanStep Break(std::string reason);

  ScanPhase phase() const { return phase_; }
  std::uint64_t profiles() const { return profiles_; }
  std::uint64_t points() const { return points_; }
  // Came a second time, and were left out.
  std::uint64_t repeated_profiles() const { return repeated_; }
  // Gaps in the scanner's count, wherever they were lost, and what was lost before a gap event that
  // no profile followed.
  std::uint64_t lost_profiles() const;
  std::uint64_t ignored_profiles() const { return ignored_; }  // outside of scans
  const std::string& reason() const { return reason_; }

 private:
  void Begin();
  void End();
  // Takes note of the number; false when it was there already.
  bool IsNew(std::uint64_t sequence);

  ScanRules rules_;
  ScanPhase phase_ = ScanPhase::kWaiting;
  std::uint64_t profiles_ = 0;
  std::uint64_t points_ = 0;
  std::uint64_t ignored_ = 0;
  std::uint64_t repeated_ = 0;
  std::uint64_t lost_at_end_ = 0;
  std::vector<bool> seen_;  // numbers, from seen_from_ on
  std::uint64_t seen_from_ = 0;
  std::uint64_t first_sequence_ = 0;  // the smallest, which may come late
  std::uint64_t last_sequence_ = 0;
  std::optional<std::int64_t> first_t_ns_;
  std::string reason_;
};

}  // namespace bendloop::host
