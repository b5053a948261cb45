// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <functional>
#include <list>
#include <memory>
#include <optional>
#include <string>

#include "firmware-host/acquisition/acquisition.h"
#include "firmware-host/cell/bender_desk.h"
#include "firmware-host/cell/bender_follower.h"
#include "firmware-host/cell/cell_status.h"
#include "firmware-host/cell/life_signs.h"
#include "firmware-host/cell/part_plan.h"
#include "firmware-host/cell/part_run.h"
#include "firmware-host/cell/run_context.h"
#include "firmware-host/cell/scan_permit.h"
#include "firmware-host/cell/scan_state.h"
#include "firmware-host/cell/waiting_part.h"
#include "firmware-host/recorder/recorder.h"
#include "firmware-host/workers/side_thread.h"
#include "firmware-host/workers/want_of_memory.h"
#include "hal/clock.h"
#include "pipeline/reconstruction.h"

namespace bendloop::host {

// A scan that led to no measurement.
struct FailedScan {
  ScanIdentity identity;
  hal::Error error;
  std::uint64_t profiles = 0;  // that it had
};

// What the loop needs from the outside; everything outlives it.
struct CellPorts {
  hal::Clock* clock = nullptr;
  BenderDesk* desk = nullptr;
  StatusBoard* board = nullptr;
  Recorder* recorder = nullptr;  // nullptr: nothing is recorded (a replay)
  // Live, what the PLC is to read of the cell; nullptr: nothing.
  PlcReporter* reporter = nullptr;
  // The part of the scan that begins, by what the PLC says; an error where there is none, and the
  // scan is recorded and held. Empty function: the loop's own part.
  std::function<hal::Result<std::shared_ptr<const PartPlan>>(const hal::PlcOrders&)> part_of_scan;
  // Names the scan that begins.
  std::function<ScanIdentity()> identify;
  // A replay gives what was recorded with the session; otherwise empty, and the ledger is asked.
  std::optional<RunContext> recorded;
  // When the scan of a replay ended that may write to a real bender.
  std::optional<Moment> recorded_end;
  // What this lot has taught so far.
  std::function<std::optional<pipeline::LotState>()> lot;
  // Comes once more for a part that waited.
  std::function<void(PartOutcome)> part_done;
  // The end of a commit that was not known when its part was done.
  std::function<void(const SettledCommit&)> commit_settled;
  std::function<void(const FailedScan&)> scan_failed;
  // Several times a second while a scan runs: what it shows so far.
  std::function<void(const pipeline::LiveView&)> viewed;
  // A few times a second, in scans too.
  std::function<void(const BenderReading&)> bender_heard;
  // A few times a second between two parts, while nothing is scanned or decided: what people ask
  // for. While a correction waits for the bender nothing that it stands in the way of; who asks for
  // that is returned ("": nobody), the correction is given up for it, and the call comes again. May
  // block for the bender's timeouts.
  std::function<std::string(bool correction_waits)> between_parts;
  // Again and again while all goes on, from the loop's own thread (watchdog).
  std::function<void()> alive;
};

struct CellLoopOptions {
  ScanRules scan;
  // A live sweep without points for so long is over (ScanRules::ends_by_coverage).
  std::chrono::nanoseconds silence = std::chrono::seconds(5);
  std::uint64_t max_parts = 0;  // scans, successful or not; 0: no end
};

enum class CellEnd : std::uint8_t {
  kStopped,     // by Stop
  kPartsDone,   // max_parts were reached
  kSourceEnd,   // the recording is over
  kSourceFault  // the scanner is gone: Acquisition::fault()
};

// Where there is no memory for a step of the loop it ends there, is counted (CellSnapshot::
// memory_wants), and the loop goes on: a scan that runs is dropped and told, a part that is decided
// is told as not measured. A commit that was on its way then is settled by the next look at the
// bender, as after a crash.
//
// The cell's one loop, the same for the daemon, a replay and the demo:
//   read();    what the scanner gave
//   update();  the scan and the reconstruction that grows with it
//   write();   a part that is complete goes through inspection to the bender
class CellLoop {
 public:
  CellLoop(const PartPlan& plan, CellPorts ports, const CellLoopOptions& options);
  // A correction that still waits for the bender is given up, and told so.
  ~CellLoop();

  // Serves one opened source until it ends.
  CellEnd Run(Acquisition& acquisition, ProfileRing& ring, const hal::SourceInfo& source);
  // What there is to do without a scanner: what the bender says, corrections that wait. A few times
  // a second.
  void Tend();
  // From any thread or signal handler.
  void Stop() { stop_.store(true, std::memory_order_relaxed); }
  std::uint64_t parts() const { return parts_; }

 private:
  void Read(ProfileRing& ring);
  void Update();
  void Write();

  // Does `work`; where there is no memory for it that is counted, under a name that stays for ever,
  // and false.
  template <class Work>
  bool Try(const char* name, Work&& work) {
    if (HasMemoryFor(work)) return true;
    ports_.board->OutOfMemory(name);
    return false;
  }
  void UpdateAndWrite();
  void CutShort();
  // Does `work` beside the loop and waits for it, telling that it lives.
  void Watched(const std::function<void()>& work);
  void Live();
  void TakeBenderNews();
  void HeardOrders(const hal::PlcOrders& orders);
  void TakeOrdersOfScan();
  void HoldScan();
  void ServePeople();
  void GiveUpWaiting(const std::string& why);
  void BeginScan();
  void GrowScan();
  bool NominalIsCovered();
  void MarkGap();
  void WatchSweep();
  void WatchSilence();
  void FinishScan();
  PartOutcome Decide(MeasuredPart part);
  void TellPart(const PartOutcome& outcome, bool again);
  void DropScan(hal::Error error);
  void TellFailed(hal::Error error, bool is_part);
  void PublishCounters(const Acquisition& acquisition, const ProfileRing& ring);

  std::shared_ptr<const PartPlan> plan_;  // of the running scan, or of the last one
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
  std::chrono::nanoseconds served_{0};
  LifeSigns life_;
  SideThread beside_;
  WaitingPart waiting_;
  std::list<SettledCommit> settled_;        // that nobody was told of yet
  std::optional<BenderFollower> follower_;  // live, with a bender

  hal::PlcOrders orders_;  // as last heard

  // Of the running scan.
  ScanIdentity identity_;
  bool is_untold_ = false;  // it has its name, and nobody was told yet what became of it
  std::string held_;        // why nothing is made of it; empty: something is
  ScanPermit permit_;
  std::optional<pipeline::Reconstruction> reconstruction_;
  std::int64_t began_ns_ = 0;  // by the ledger's clock
  pipeline::LiveView live_;
  std::chrono::nanoseconds view_due_{0};
  std::int64_t last_arrival_ns_ = 0;      // of a profile of the scan
  std::chrono::nanoseconds heard_at_{0};  // when the latest slot came
  std::int64_t points_at_ns_ = 0;         // when the latest profile with points came
  bool silent_ = false;
};

}  // namespace bendloop::host
