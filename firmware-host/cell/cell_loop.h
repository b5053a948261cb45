// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <string>

#include "firmware-host/acquisition/acquisition.h"
#include "firmware-host/cell/bender_desk.h"
#include "firmware-host/cell/cell_status.h"
#include "firmware-host/cell/part_plan.h"
#include "firmware-host/cell/part_run.h"
#include "firmware-host/cell/run_context.h"
#include "firmware-host/cell/scan_state.h"
#include "firmware-host/recorder/recorder.h"
#include "hal/clock.h"
#include "pipeline/reconstruction.h"

namespace bendloop::host {

// A scan that led to no measurement.
struct FailedScan {
  ScanIdentity identity;
  hal::Error error;
};

// What the loop needs from the outside; everything outlives it.
struct CellPorts {
  hal::Clock* clock = nullptr;
  BenderDesk* desk = nullptr;
  StatusBoard* board = nullptr;
  Recorder* recorder = nullptr;  // nullptr: nothing is recorded (a replay)
  // Names the scan that begins.
  std::function<ScanIdentity()> identify;
  // A replay gives what was recorded with the session; otherwise empty, and the bender is asked.
  std::optional<RunContext> recorded;
  // What this lot has taught so far.
  std::function<std::optional<pipeline::LotState>()> lot;
  std::function<void(PartOutcome)> part_done;
  std::function<void(const FailedScan&)> scan_failed;
  // Several times a second while a scan runs: what it shows so far.
  std::function<void(const pipeline::LiveView&)> viewed;
  // Between scans, about once a second.
  std::function<void(const BenderReading&)> bender_heard;
  // At every turn, from the loop's own thread (watchdog).
  std::function<void()> alive;
};

struct CellLoopOptions {
  ScanRules scan;
  bool ends_by_coverage = false;
  std::uint64_t max_parts = 0;  // scans, successful or not; 0: no end
};

enum class CellEnd : std::uint8_t {
  kStopped,     // by Stop
  kPartsDone,   // max_parts were reached
  kSourceEnd,   // the recording is over
  kSourceFault  // the scanner is gone: Acquisition::fault()
};

// The cell's one loop, the same for the daemon, a replay and the demo:
//   read();    what the scanner gave
//   update();  the scan and the reconstruction that grows with it
//   write();   a part that is complete goes through inspection to the bender
class CellLoop {
 public:
  CellLoop(const PartPlan& plan, CellPorts ports, const CellLoopOptions& options);

  // Serves one opened source until it ends.
  CellEnd Run(Acquisition& acquisition, ProfileRing& ring, const hal::SourceInfo& source);
  // From any thread or signal handler.
  void Stop() { stop_.store(true, std::memory_order_relaxed); }
  std::uint64_t parts() const { return parts_; }

 private:
  void Read(ProfileRing& ring);
  void Update();
  void Write();

  void AskBender();
  void BeginScan();
  void GrowScan();
  bool NominalIsCovered();
  void MarkGap();
  void WatchSilence();
  void FinishScan();
  void DropScan(hal::Error error);
  void PublishCounters(const Acquisition& acquisition, const ProfileRing& ring);

  const PartPlan plan_;
  CellPorts ports_;
  const CellLoopOptions options_;
  std::atomic<bool> stop_{false};

  ScanState scan_;
  Slot* slot_ = nullptr;
  ScanStep step_ = ScanStep::kNothing;
  bool source_ended_ = false;
  bool source_failed_ = false;
  std::string scanner_;
  std::uint64_t parts_ = 0;
  std::chrono::nanoseconds published_{0};
  // The desk is used by one of these at a time: asked in between scans, read at a scan's start.
  std::future<BenderReading> asked_;
  std::chrono::nanoseconds asked_at_{0};

  // Of the running scan.
  ScanIdentity identity_;
  std::optional<pipeline::Reconstruction> reconstruction_;
  std::future<RunContext> base_;
  pipeline::LiveView live_;
  std::chrono::nanoseconds view_due_{0};
  std::int64_t last_arrival_ns_ = 0;      // of a profile of the scan
  std::chrono::nanoseconds heard_at_{0};  // when the latest slot came
  bool silent_ = false;
};

}  // namespace bendloop::host
