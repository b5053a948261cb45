// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

#include "drivers/session/session_reader.h"
#include "hal/clock.h"
#include "hal/profile_source.h"

namespace bendloop::drivers {

enum class ReplayPace {
  kMax,       // as fast as the reader asks
  kRecorded,  // as the times t_ns in the file say
};

// Replays a session file: profiles in the order of seq, events between them by t_ns. At the same
// time an event comes before the profile, scan_end after it. A profile that its checksum shows to
// be damaged is left out and counted: its number is missing, as that of a lost one. Other errors
// are kBadInput and final. SQLite allocates while it reads: a replay is not for a thread that must
// not.
class SessionSource final : public hal::ProfileSource {
 public:
  // `clock` must outlive the source; pace kMax never looks at it.
  SessionSource(std::string path, ReplayPace pace, hal::Clock& clock)
      : path_(std::move(path)), pace_(pace), clock_(clock) {}

  hal::Result<hal::SourceInfo> Open() override;
  hal::Result<void> Start() override;
  hal::Result<hal::ReadStatus> Read(hal::LaserProfile& profile, hal::ScanEvent& event,
                                    std::chrono::nanoseconds timeout) override;
  void Stop() override {}

  // After Open(): the file's meta, and counters of what was read.
  const SessionReader* reader() const { return reader_ ? &*reader_ : nullptr; }
  // So far, and what was wrong with the first of them.
  std::size_t profiles_left_out() const { return profiles_left_out_; }
  const std::string& first_damage() const { return first_damage_; }

 private:
  // False if `t_ns` is not due before the timeout; then the clock stands at the timeout.
  bool WaitUntilDue(std::int64_t t_ns, std::chrono::nanoseconds timeout);
  hal::Result<hal::ReadStatus> FailForGood(hal::Error error);
  // An error without failed_: the profile was left out.
  hal::Result<hal::ReadStatus> ReadNext(hal::LaserProfile& profile, hal::ScanEvent& event,
                                        std::chrono::nanoseconds timeout);
  hal::Result<hal::ReadStatus> LeaveOut(hal::Error error);

  std::string path_;
  ReplayPace pace_;
  hal::Clock& clock_;
  std::optional<SessionReader> reader_;
  std::optional<hal::Error> failed_;
  std::chrono::nanoseconds started_{0};
  std::optional<std::int64_t> first_t_ns_;
  std::size_t profiles_left_out_ = 0;
  std::string first_damage_;
  bool pending_event_read_ = false;
  hal::ScanEvent pending_event_;
};

}  // namespace bendloop::drivers
