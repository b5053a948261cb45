// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acquisition/profile_ring.h"

#include <algorithm>

namespace bendloop::host {

ProfileRing::ProfileRing(std::size_t slots, std::size_t max_points)
    : free_(std::max<std::size_t>(slots, 2) + kEventReserve),
      filled_(std::max<std::size_t>(slots, 2) + kEventReserve) {
  const std::size_t count = std::max<std::size_t>(slots, 2) + kEventReserve + 1;
  slots_.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    slots_.emplace_back().profile = hal::LaserProfile(max_points);
    // Touch the pages now: a page fault in the middle of a scan is lateness.
    slots_.back().profile.points.resize(max_points);
    slots_.back().profile.intensity.resize(max_points);
    slots_.back().profile.points.clear();
    slots_.back().profile.intensity.clear();
    if (i > 0) free_.TryPut(static_cast<std::uint32_t>(i));
  }
}

bool ProfileRing::TryPublish() {
  const bool is_profile = Writing().kind == SlotKind::kProfile;
  if (is_profile && free_.size_approx() <= kEventReserve) return false;
  std::uint32_t next = 0;
  if (!free_.TryTake(next)) return false;
  filled_.TryPut(writing_);  // never full: it has room for every slot but the writer's
  writing_ = next;
  return true;
}

bool ProfileRing::PublishWithin(std::chrono::microseconds timeout) {
  std::uint32_t next = 0;
  if (!free_.TakeWithin(next, timeout)) return false;
  filled_.TryPut(writing_);
  writing_ = next;
  return true;
}

Slot* ProfileRing::TakeWithin(std::chrono::microseconds timeout) {
  std::uint32_t index = 0;
  if (!filled_.TakeWithin(index, timeout)) return nullptr;
  reading_ = index;
  return &slots_[index];
}

void ProfileRing::Release() {
  if (reading_ == kNone) return;
  free_.TryPut(reading_);
  reading_ = kNone;
}

}  // namespace bendloop::host
