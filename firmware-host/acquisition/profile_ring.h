// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "hal/bounded_queue.h"
#include "hal/laser_profile.h"
#include "hal/scan_event.h"

namespace bendloop::host {

enum class SlotKind : std::uint8_t {
  kProfile,
  kEvent,
  kEnd,    // a recording is over
  kFault,  // the source failed for good
};

// What travels from the acquisition thread to the pipeline thread.
struct Slot {
  SlotKind kind = SlotKind::kProfile;
  std::uint32_t dropped_before = 0;  // profiles lost between the slot before and this one
  std::int64_t arrived_ns = 0;       // on the host's clock
  hal::LaserProfile profile;
  hal::ScanEvent event;
};

// A bounded ring of preallocated slots between one writer and one reader. Only indices travel, so
// neither side copies a profile, allocates or takes a lock. The writer always owns one slot to read
// into; it hands that over only in exchange for a free one.
class ProfileRing {
 public:
  // Slots kept back for events, so that a scan's end gets through a ring full of profiles.
  static constexpr std::size_t kEventReserve = 8;

  ProfileRing(std::size_t slots, std::size_t max_points);

  // Writer: the slot to fill next.
  Slot& Writing() { return slots_[writing_]; }
  // Writer: hands the slot over if the ring has room for one more of its kind; at once.
  bool TryPublish();
  // Writer: the same, waiting for room; for sources that can wait.
  bool PublishWithin(std::chrono::microseconds timeout);

  // Reader: the oldest slot, or nullptr when none came in time. It stays the reader's until
  // Release.
  Slot* TakeWithin(std::chrono::microseconds timeout);
  void Release();

  // Either side: slots waiting for the reader.
  std::size_t Filled() const { return filled_.size_approx(); }
  std::size_t capacity() const { return slots_.size() - 1; }

 private:
  using Indices = hal::BoundedQueue<std::uint32_t>;
  static constexpr std::uint32_t kNone = ~0u;

  std::vector<Slot> slots_;
  Indices free_;
  Indices filled_;
  std::uint32_t writing_ = 0;
  std::uint32_t reading_ = kNone;
};

}  // namespace bendloop::host
