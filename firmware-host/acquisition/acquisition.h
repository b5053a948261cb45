// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <limits>
#include <optional>
#include <thread>

#include "firmware-host/acquisition/clock_drift.h"
#include "firmware-host/acquisition/profile_ring.h"
#include "firmware-host/acquisition/realtime.h"
#include "hal/clock.h"
#include "hal/error.h"
#include "hal/profile_source.h"

namespace bendloop::host {

// Written by the acquisition thread, read by anyone.
struct AcquisitionCounters {
  std::atomic<std::uint64_t> profiles{0};
  std::atomic<std::uint64_t> points{0};
  std::atomic<std::uint64_t> events{0};
  std::atomic<std::uint64_t> dropped_profiles{0};  // the ring was full
  std::atomic<std::uint64_t> dropped_events{0};
  std::atomic<std::uint64_t> missing_profiles{0};    // gaps in the scanner's own count
  std::atomic<std::uint64_t> repeated_profiles{0};   // the number of the one before, again
  std::atomic<std::uint64_t> reordered_profiles{0};  // a number smaller than the one before
  std::atomic<std::uint64_t> queue_peak{0};          // slots
  // Delay of a profile beyond the quickest one of its scan: (arrival - exposure) - min.
  std::atomic<std::int64_t> lateness_last_ns{0};
  std::atomic<std::int64_t> lateness_peak_ns{0};
  // The scanner's clock against ours [ppm], positive: fast (ClockDrift); NaN: not known.
  std::atomic<double> clock_drift_ppm{std::numeric_limits<double>::quiet_NaN()};
};

struct AcquisitionOptions {
  std::chrono::milliseconds read_timeout{50};
  RealtimePolicy realtime;
};

// Moves profiles from a source into the ring on a thread of its own that allocates nothing, takes
// no lock, logs nothing and waits for nobody. When the ring is full, a live source's profile is
// dropped, counted, and the gap is marked in the next slot; a recording waits instead, so that a
// replay loses nothing at any pace.
class Acquisition {
 public:
  Acquisition(hal::ProfileSource& source, const hal::SourceInfo& info, ProfileRing& ring,
              const hal::Clock& clock, const AcquisitionOptions& options);
  ~Acquisition();
  Acquisition(const Acquisition&) = delete;
  Acquisition& operator=(const Acquisition&) = delete;

  // Starts the source and the thread. kDevice when real time is required and not permitted.
  hal::Result<void> Start();
  // Ends the thread, then the source. Safe to call twice.
  void Stop();

  // The loop itself, for tests that want it on their own thread; returns at the end of the source
  // or after RequestStop.
  void Run();
  void RequestStop() { stop_.store(true, std::memory_order_relaxed); }

  const AcquisitionCounters& counters() const { return counters_; }
  // Why the source failed; read it after a kFault slot.
  const hal::Error& fault() const { return fault_; }
  // What the realtime policy could not have ("" if all was granted), for the log.
  const std::string& realtime_note() const { return realtime_note_; }

 private:
  hal::Result<hal::ReadStatus> ReadOrTell(Slot& slot);
  void TakeProfile(Slot& slot);
  void TakeEvent(Slot& slot);
  void Finish(SlotKind kind);
  bool Publish();

  hal::ProfileSource& source_;
  const bool is_live_;
  ProfileRing& ring_;
  const hal::Clock& clock_;
  const AcquisitionOptions options_;
  AcquisitionCounters counters_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
  hal::Error fault_;
  std::string realtime_note_;

  // Of the loop alone.
  std::uint32_t dropped_since_ = 0;
  std::optional<std::uint64_t> last_sequence_;
  std::optional<std::int64_t> quickest_ns_;
  ClockDrift drift_;
};

}  // namespace bendloop::host
