// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "firmware-host/acquisition/acquisition.h"
#include "firmware-host/recorder/recorder.h"
#include "firmware-host/result/json.h"
#include "hal/bend_program.h"
#include "hal/bender_state.h"
#include "pipeline/reconstruction.h"

namespace bendloop::host {

enum class CellPhase : std::uint8_t {
  kStarting,
  kNoScanner,  // trying to reach it again
  kWaiting,    // for a scan
  kScanning,
  kDeciding,    // final fit
  kCommitting,  // inspection, correction, bender
  kStopping,
};
const char* Name(CellPhase phase);
const char* Name(hal::BenderMode mode);

struct LastPart {
  std::string session;
  // "corrected", "unchanged", "refused", "link down", "waiting", "repeat", "not measured"
  std::string end;
  std::string verdict;                    // "pass", "fail", "undecided", "" when not measured
  std::string reason;                     // the first one, or ""
  std::vector<std::string> notices = {};  // of the correction
  std::optional<double> forecast = {};    // that the next tube is in tolerance, 0..1
  std::optional<pipeline::PassBeside> furthest_pass = {};  // of its scan; empty: they met
};

// What the correction goes by, in short.
struct ShownLot {
  std::uint32_t number = 0;  // 0: there is none yet
  std::uint32_t parts = 0;   // learnt from
  bool held = false;         // by somebody: no program is changed
  std::string temperament;   // "steady", "drifting", ...
};

// What the cell is doing, for people and monitors.
struct CellSnapshot {
  CellPhase phase = CellPhase::kStarting;
  std::string cell;
  std::string part;
  std::string scanner;  // model and serial, or why there is none
  std::string bender;   // address
  std::string bender_state;
  std::uint32_t bender_sequence = 0;    // of its active program
  std::uint32_t bender_parts_bent = 0;  // its count, as the ledger has seen it
  std::string session;                  // of the running scan, "" between scans
  pipeline::LiveView live;              // of the running scan
  double nominal_length_mm = 0;
  std::uint64_t parts = 0;  // finished since the start, whatever became of them
  std::uint64_t corrected = 0;
  std::uint64_t refused = 0;
  std::uint64_t repeats = 0;  // scans of a tube that was decided of before
  std::uint64_t failed_scans = 0;
  // From the arrival of the last profile, of the latest part and of the slowest.
  double last_lra_ms = 0;  // to the final LRA
  double peak_lra_ms = 0;
  double last_end_ms = 0;  // to the bender's answer
  double peak_end_ms = 0;
  double last_decision_ms = 0;  // from the scan's end to the bender's answer
  double peak_decision_ms = 0;
  std::optional<LastPart> last;
  std::string problem;  // what of the last part could not be kept, and why; "": all of it was
  ShownLot lot;

  // Of the acquisition and the recorder.
  std::uint64_t profiles = 0;
  std::uint64_t points = 0;
  std::uint64_t dropped_profiles = 0;
  std::uint64_t missing_profiles = 0;
  std::uint64_t dropped_events = 0;
  std::uint64_t repeated_profiles = 0;
  std::uint64_t reordered_profiles = 0;
  std::uint64_t silences = 0;  // of the scanner, in the middle of a scan
  std::uint64_t queue_now = 0;
  std::uint64_t queue_peak = 0;
  std::uint64_t queue_capacity = 0;
  double lateness_last_ms = 0;
  double lateness_peak_ms = 0;
  std::optional<double> clock_drift_ppm;  // of the scanner, positive: fast; empty: not known yet
  std::uint64_t recorded_sessions = 0;
  std::uint64_t recorder_dropped = 0;
  std::uint64_t recorder_dropped_events = 0;
  std::uint64_t recorder_dropped_sessions = 0;
  std::string recorder_error;
  std::uint64_t recorder_waiting_points = 0;
  std::uint64_t removed_sessions = 0;
  std::uint64_t disk_used_mb = 0;  // by sessions
  std::uint64_t disk_free_mb = 0;
  std::uint64_t disk_free_names = UINT64_MAX;  // retention/free_space.h
  bool knows_disk = false;                     // it was looked at

  std::uint64_t memory_wants = 0;  // times that something was left off for want of memory
  const char* memory_want = "";    // what, the last time
};

// The counters of those who feed the cell.
void ShowAcquisition(const AcquisitionCounters& counters, const ProfileRing& ring,
                     CellSnapshot& snapshot);
void ShowRecorder(const RecorderCounters& counters, CellSnapshot& snapshot);

// What a running scan shows, for people: "bend 3 seen, 41.2 +- 0.1 degree; 180 mm of 620 still
// missing".
std::string ProgressLine(const pipeline::LiveView& view, double nominal_length_mm);

// The latest snapshot, between the cell's thread and whoever asks.
class StatusBoard {
 public:
  template <class F>
  void Update(F&& change) {
    const std::lock_guard lock(mutex_);
    change(snapshot_);
  }
  // Something was left off for want of memory; needs none. `what` stays for ever.
  void OutOfMemory(const char* what) noexcept {
    const std::lock_guard lock(mutex_);
    ++snapshot_.memory_wants;
    snapshot_.memory_want = what;
  }
  CellSnapshot Get() const {
    const std::lock_guard lock(mutex_);
    return snapshot_;
  }

 private:
  mutable std::mutex mutex_;
  CellSnapshot snapshot_;
};

// Schema "bendloop.status/1".
Json StatusJson(const CellSnapshot& snapshot);
// The same for `bendloop status`: the active alarms, then one "name  value" a line.
std::string StatusText(const Json& status);
// Prometheus text exposition, version 0.0.4.
std::string MetricsText(const CellSnapshot& snapshot);

}  // namespace bendloop::host
