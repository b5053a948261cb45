// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "hal/laser_profile.h"
#include "hal/scan_event.h"

namespace bendloop::host {

struct ScanRules {
  bool is_live = true;
  bool starts_by_event = true;  // live: profiles before scan_start belong to no scan
  double max_seconds = 120;     // by the profiles' own times
  std::uint32_t min_profiles = 20;
};

enum class ScanPhase : std::uint8_t { kWaiting, kScanning };

// What a slot means for the scan.
enum class ScanStep : std::uint8_t {
  kNothing,  // does not belong to a scan
  kBegan,    // a scan starts with this slot
  kGrew,     // the slot belongs to the scan that runs
  kEnded,    // the scan is complete
  kBroke,    // the scan is over and worth nothing: reason()
};

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
  // The scanner or the daemon went away.
  ScanStep Break(std::string reason);

  ScanPhase phase() const { return phase_; }
  std::uint64_t profiles() const { return profiles_; }
  std::uint64_t points() const { return points_; }
  // Gaps in the scanner's count, wherever they were lost.
  std::uint64_t lost_profiles() const;
  std::uint64_t ignored_profiles() const { return ignored_; }  // outside of scans
  const std::string& reason() const { return reason_; }

 private:
  void Begin();

  ScanRules rules_;
  ScanPhase phase_ = ScanPhase::kWaiting;
  std::uint64_t profiles_ = 0;
  std::uint64_t points_ = 0;
  std::uint64_t ignored_ = 0;
  std::uint64_t first_sequence_ = 0;
  std::uint64_t last_sequence_ = 0;
  std::optional<std::int64_t> first_t_ns_;
  std::string reason_;
};

}  // namespace bendloop::host
