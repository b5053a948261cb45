// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acquisition/acquisition.h"

#include <pthread.h>

#include <algorithm>
#include <future>
#include <new>
#include <utility>

#include "hal/saturating.h"

namespace bendloop::host {
namespace {

// Profiles between two looks at the clocks.
constexpr std::uint64_t kDriftPeriod = 64;

// There is one writer, so load and store need no read-modify-write.
template <class T>
void Raise(std::atomic<T>& peak, T value) {
  if (value > peak.load(std::memory_order_relaxed)) peak.store(value, std::memory_order_relaxed);
}

template <class T>
void Count(std::atomic<T>& counter, T by = 1) {
  counter.store(counter.load(std::memory_order_relaxed) + by, std::memory_order_relaxed);
}

}  // namespace

Acquisition::Acquisition(hal::ProfileSource& source, const hal::SourceInfo& info, ProfileRing& ring,
                         const hal::Clock& clock, const AcquisitionOptions& options)
    : source_(source), is_live_(info.is_live), ring_(ring), clock_(clock), options_(options) {}

Acquisition::~Acquisition() { Stop(); }

hal::Result<void> Acquisition::Start() {
  if (auto started = source_.Start(); !started) return hal::Fail(started.error());
  std::promise<hal::Result<std::string>> ready;
  auto granted = ready.get_future();
  thread_ = std::thread([this, &ready] {
    pthread_setname_np(pthread_self(), "acquisition");
    auto applied = ApplyRealtime(options_.realtime);
    const bool go = applied.has_value();
    ready.set_value(std::move(applied));
    if (go) Run();
  });
  auto note = granted.get();
  if (!note) {
    Stop();
    return hal::Fail(note.error());
  }
  realtime_note_ = std::move(*note);
  return {};
}

void Acquisition::Stop() {
  RequestStop();
  if (!thread_.joinable()) return;
  thread_.join();
  source_.Stop();
}

void Acquisition::Run() {
  while (!stop_.load(std::memory_order_relaxed)) {
    Slot& slot = ring_.Writing();
    const auto status = ReadOrTell(slot);
    if (!status) {
      fault_ = status.error();
      return Finish(SlotKind::kFault);
    }
    switch (*status) {
      case hal::ReadStatus::kProfile:
        TakeProfile(slot);
        break;
      case hal::ReadStatus::kEvent:
        TakeEvent(slot);
        break;
      case hal::ReadStatus::kTimeout:
        break;
      case hal::ReadStatus::kEnd:
        return Finish(SlotKind::kEnd);
    }
  }
}

// Where there is no memory for what the scanner sent its stream is lost: it is opened anew.
hal::Result<hal::ReadStatus> Acquisition::ReadOrTell(Slot& slot) {
  try {
    return source_.Read(slot.profile, slot.event, options_.read_timeout);
  } catch (const std::bad_alloc&) {
    return hal::Fail(hal::ErrorKind::kDevice, "out of memory");  // short enough to need none
  }
}

void Acquisition::TakeProfile(Slot& slot) {
  const hal::LaserProfile& profile = slot.profile;
  const std::uint64_t points = profile.points.size();
  if (last_sequence_ && profile.sequence > *last_sequence_) {
    Count(counters_.missing_profiles, profile.sequence - *last_sequence_ - 1);
  }
  if (last_sequence_ && profile.sequence == *last_sequence_) {
    Count<std::uint64_t>(counters_.repeated_profiles);
  }
  if (last_sequence_ && profile.sequence < *last_sequence_) {
    Count<std::uint64_t>(counters_.reordered_profiles);
  }
  last_sequence_ = std::max(profile.sequence, last_sequence_.value_or(0));
  slot.arrived_ns = clock_.Now().count();
  if (is_live_) {
    const std::int64_t delay = hal::SaturatingDifference(slot.arrived_ns, profile.t_ns);
    drift_.Add(profile.t_ns, slot.arrived_ns);
    if (counters_.profiles.load(std::memory_order_relaxed) % kDriftPeriod == 0) {
      if (const auto ppm = drift_.Ppm()) {
        counters_.clock_drift_ppm.store(*ppm, std::memory_order_relaxed);
      }
    }
    quickest_ns_ = std::min(delay, quickest_ns_.value_or(delay));
    const std::int64_t lateness = hal::SaturatingDifference(delay, *quickest_ns_);
    counters_.lateness_last_ns.store(lateness, std::memory_order_relaxed);
    Raise(counters_.lateness_peak_ns, lateness);
  }
  slot.kind = SlotKind::kProfile;
  slot.dropped_before = dropped_since_;
  if (!Publish()) {
    ++dropped_since_;
    Count<std::uint64_t>(counters_.dropped_profiles);
    return;
  }
  dropped_since_ = 0;
  Count<std::uint64_t>(counters_.profiles);
  Count(counters_.points, points);
}

void Acquisition::TakeEvent(Slot& slot) {
  if (slot.event.kind == hal::ScanEventKind::kScanStart) {
    // A new scan: the scanner may count from the start again, and the clocks have drifted.
    last_sequence_.reset();
    quickest_ns_.reset();
  }
  slot.kind = SlotKind::kEvent;
  slot.dropped_before = dropped_since_;
  if (!Publish()) {
    Count<std::uint64_t>(counters_.dropped_events);
    return;
  }
  dropped_since_ = 0;
  Count<std::uint64_t>(counters_.events);
}

bool Acquisition::Publish() {
  if (is_live_) {
    if (!ring_.TryPublish()) return false;
  } else {
    while (!ring_.PublishWithin(options_.read_timeout)) {
      if (stop_.load(std::memory_order_relaxed)) return false;
    }
  }
  Raise<std::uint64_t>(counters_.queue_peak, ring_.Filled());
  return true;
}

void Acquisition::Finish(SlotKind kind) {
  Slot& slot = ring_.Writing();
  slot.kind = kind;
  slot.dropped_before = dropped_since_;
  // The reader must learn of the end, so this one waits.
  while (!ring_.PublishWithin(options_.read_timeout)) {
    if (stop_.load(std::memory_order_relaxed)) return;
  }
}

}  // namespace bendloop::host
