// SPDX-License-Identifier: Apache-2.0
#include "drivers/session/session_source.h"

#include <limits>

namespace bendloop::drivers {

using hal::Fail;
using hal::ReadStatus;
using hal::Result;
using std::chrono::nanoseconds;

namespace {

// What lies between two times of a file, which may be any numbers.
nanoseconds Between(std::int64_t from_ns, std::int64_t to_ns) {
  if (to_ns <= from_ns) return nanoseconds(0);
  const std::uint64_t apart =
      static_cast<std::uint64_t>(to_ns) - static_cast<std::uint64_t>(from_ns);
  constexpr std::uint64_t kMost = std::numeric_limits<std::int64_t>::max() / 2;
  return nanoseconds(static_cast<std::int64_t>(apart < kMost ? apart : kMost));
}

}  // namespace

Result<hal::SourceInfo> SessionSource::Open() {
  reader_.reset();
  failed_.reset();
  first_t_ns_.reset();
  pending_event_read_ = false;
  profiles_left_out_ = 0;
  first_damage_.clear();
  auto reader = SessionReader::Open(path_);
  if (!reader) return Fail(reader.error());
  reader_.emplace(std::move(*reader));
  hal::SourceInfo info;
  info.model = reader_->MetaOr("scanner", "recorded session");
  info.serial = reader_->MetaOr("scanner_serial", "");
  info.firmware = reader_->MetaOr("scanner_firmware", "");
  info.is_live = false;
  info.max_points = reader_->max_points();
  return info;
}

Result<void> SessionSource::Start() {
  if (!reader_) return Fail(hal::ErrorKind::kInternal, path_ + ": the session is not open");
  if (pace_ == ReplayPace::kRecorded) started_ = clock_.Now();
  return {};
}

bool SessionSource::WaitUntilDue(std::int64_t t_ns, nanoseconds timeout) {
  if (pace_ == ReplayPace::kMax) return true;
  if (!first_t_ns_) first_t_ns_ = t_ns;
  const nanoseconds now = clock_.Now();
  const nanoseconds wait = Between(*first_t_ns_, t_ns) - (now - started_);
  if (wait > timeout) {
    clock_.SleepUntil(now + timeout);
    return false;
  }
  if (wait > nanoseconds(0)) clock_.SleepUntil(now + wait);
  return true;
}

Result<ReadStatus> SessionSource::FailForGood(hal::Error error) {
  failed_ = error;
  return Fail(std::move(error));
}

Result<ReadStatus> SessionSource::Read(hal::LaserProfile& profile, hal::ScanEvent& event,
                                       nanoseconds timeout) {
  while (true) {
    auto status = ReadNext(profile, event, timeout);
    if (status || failed_ || !reader_) return status;
  }
}

Result<ReadStatus> SessionSource::ReadNext(hal::LaserProfile& profile, hal::ScanEvent& event,
                                           nanoseconds timeout) {
  if (failed_) return Fail(*failed_);
  if (!reader_) return Fail(hal::ErrorKind::kInternal, path_ + ": the session is not open");
  const auto profile_t_ns = reader_->PeekProfile();
  if (!profile_t_ns) return LeaveOut(profile_t_ns.error());
  if (!pending_event_read_) {
    const auto found = reader_->NextEvent(pending_event_);
    if (!found) return FailForGood(found.error());
    pending_event_read_ = *found;
  }
  if (pending_event_read_) {
    const bool is_first = !*profile_t_ns || pending_event_.t_ns < **profile_t_ns ||
                          (pending_event_.t_ns == **profile_t_ns &&
                           pending_event_.kind != hal::ScanEventKind::kScanEnd);
    if (is_first) {
      if (!WaitUntilDue(pending_event_.t_ns, timeout)) return ReadStatus::kTimeout;
      event = pending_event_;
      pending_event_read_ = false;
      return ReadStatus::kEvent;
    }
  }
  if (!*profile_t_ns) return ReadStatus::kEnd;
  if (!WaitUntilDue(**profile_t_ns, timeout)) return ReadStatus::kTimeout;
  const auto taken = reader_->NextProfile(profile);
  if (!taken) return LeaveOut(taken.error());
  return ReadStatus::kProfile;
}

Result<ReadStatus> SessionSource::LeaveOut(hal::Error error) {
  if (!reader_->has_sums() || reader_->damaged()) return FailForGood(std::move(error));
  if (profiles_left_out_++ == 0) first_damage_ = std::move(error.message);
  return Fail(hal::ErrorKind::kBadInput, first_damage_);
}

}  // namespace bendloop::drivers
