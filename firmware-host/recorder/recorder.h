// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "firmware-host/retention/free_space.h"
#include "firmware-host/retention/retention.h"
#include "hal/clock.h"
#include "hal/laser_profile.h"
#include "hal/result.h"
#include "hal/scan_event.h"

namespace bendloop::host {

struct RecorderOptions {
  std::filesystem::path directory;
  // What may stay beside the recordings is looked at before each of them.
  RetentionLimits limits = {};
  std::filesystem::path results = {};  // NAME.json of each session, which goes with time, too
  // Names that must stay: of corrections that are still to be sent; an error: nobody knows, and
  // nothing goes. From the recorder's thread.
  std::function<hal::Result<std::set<std::string>>()> kept = {};
  // Points that may wait for the disk; beyond them profiles are left out of the recording.
  std::size_t queue_points = 8u << 20;  // 64 MB
  // Profiles and events that may wait, however few points they have; some 30 MB.
  std::size_t queue_items = 1u << 16;
};

// What the recorder did since it started.
struct RecorderCounters {
  std::uint64_t sessions = 0;
  std::uint64_t profiles = 0;
  std::uint64_t dropped_profiles = 0;  // the disk too slow, no memory, or profile not writable
  std::uint64_t dropped_events = 0;    // the disk too slow, or no memory
  std::uint64_t dropped_sessions = 0;  // wholly left out: the disk hung, or did not take the file
  std::uint64_t removed_sessions = 0;  // to stay within the limits
  std::uint64_t removed_results = 0;
  std::uint64_t queued_points = 0;
  std::uint64_t queued_items = 0;
  std::uint64_t sessions_bytes = 0;  // on the disk, when a session last began or ended
  FreeSpace free;                    // if knows_disk: now, or a few seconds ago
  bool knows_disk = false;           // it was looked at
  std::string last_error;            // "" while all is well
};

// Writes sessions on a thread of its own, which may lag: no call of the measuring side waits for
// the disk. What does not fit in the queue is left out, counted, told by last_error, and marked by
// a `gap` event and meta `recording` = "incomplete". Everything that waits is bounded, however long
// the disk hangs: points, profiles and events, and sessions, of which further ones are left out as
// a whole. Events have some room of their own, so that a scan's end gets through where its last
// profiles do not. Where its thread gets no memory, what it was at is left out and told likewise.
//
// A power cut costs what came in the last quarter of a second, and while the disk took what was
// before it: a session's first profiles are synced at once, later ones at that age.
class Recorder {
 public:
  using Meta = std::map<std::string, std::string>;

  // `clock` must outlive the recorder.
  Recorder(RecorderOptions options, const hal::Clock& clock);
  // Writes what is queued, then ends; waits for a disk that hangs. Who must not wait asks
  // FlushWithin() first.
  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  // `name`.session in the directory; an open session is finished first.
  void Begin(const std::string& name, Meta meta);
  void Add(const hal::LaserProfile& profile);
  void Add(const hal::ScanEvent& event);
  void Finish(Meta meta);
  // Removes what was recorded since Begin: it was no scan.
  void Discard();

  // Waits until everything given so far is on the disk.
  void Flush();
  // The same for so long at most; false: the disk hangs.
  bool FlushWithin(std::chrono::nanoseconds patience);
  RecorderCounters counters() const;
  std::filesystem::path PathOf(const std::string& name) const;

 private:
  enum class Step { kBegin, kProfile, kEvent, kGap, kFinish, kDiscard };
  // Of the session begun last, on the measuring side.
  enum class Open { kNo, kRecording, kLeftOut };
  struct Item {
    Step step = Step::kProfile;
    hal::LaserProfile profile;
    hal::ScanEvent event;
    std::string name;
    Meta meta;
    std::chrono::nanoseconds came{0};  // profiles: when they were queued, on the clock
  };
  class Session;

  // With mutex_ held, all to End.
  bool HasRoom(std::size_t items) const;
  void LeaveOut(std::uint64_t& left_out, std::uint64_t& counter);
  void MissForMemory(std::uint64_t& left_out, std::uint64_t& counter);
  void CountForMemory(std::uint64_t& counter);
  void QueueGap(std::int64_t t_ns);
  void NoGap();
  void Tell(const char* what);
  void End(Item item);
  void Run();
  void Write(Item& item, std::unique_ptr<Session>& session);
  void WriteOrTell(Item& item, std::unique_ptr<Session>& session);
  void LeaveOutForMemory(Step step, std::unique_ptr<Session>& session);
  void KeepSafe(std::unique_ptr<Session>& session);
  void Fail(const std::string& what);
  void LookAtDisk();
  void LookAtSpace();
  void MakeRoom(const std::string& name);

  const RecorderOptions options_;
  const hal::Clock& clock_;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::condition_variable idle_;
  std::deque<Item> queue_;
  std::vector<hal::LaserProfile> spare_;  // written profiles, to be used again
  RecorderCounters counters_;
  bool busy_ = false;
  bool stop_ = false;
  Open open_ = Open::kNo;
  std::string name_;                 // of the session begun last
  std::size_t queued_sessions_ = 0;  // begun, and the disk does not know yet
  std::uint64_t gap_profiles_ = 0;   // left out since the last gap that was queued
  std::uint64_t gap_events_ = 0;
  bool gap_for_disk_ = false;  // why: either, or both
  bool gap_for_memory_ = false;
  std::int64_t last_t_ns_ = 0;
  std::chrono::nanoseconds space_due_{0};  // on the clock; the recorder's thread's own
  std::thread thread_;
};

}  // namespace bendloop::host
