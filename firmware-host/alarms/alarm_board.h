// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "firmware-host/alarms/alarm_table.h"

namespace bendloop::host {

// One that was raised.
struct Alarm {
  AlarmCode code = AlarmCode::kScannerAway;
  std::string detail;              // of this case; may be empty
  std::int64_t began_ms = 0;       // wall clock, since 1970
  std::int64_t ended_ms = 0;       // 0: it goes on
  std::uint32_t acknowledged = 0;  // how often it was acknowledged while it lasted

  bool is_active() const { return ended_ms == 0; }
};

// What is wrong now, and what was wrong lately. Each code is there once at most, so that memory is
// bounded by the table. Any thread may call.
class AlarmBoard {
 public:
  // How many that have ended are kept.
  static constexpr std::size_t kRecent = 32;
  using Clock = std::function<std::int64_t()>;
  // Told of each beginning and end, in order; must not call the board.
  using Listener = std::function<void(const Alarm&)>;

  explicit AlarmBoard(Clock unix_ms, Listener listener = {})
      : unix_ms_(std::move(unix_ms)), listener_(std::move(listener)) {}

  // One that is active already goes on with the new detail.
  void Begin(AlarmCode code, const std::string& detail = {});
  // Does nothing where it is not active, or where it ends by acknowledgement alone.
  void End(AlarmCode code);
  void Set(AlarmCode code, bool is_wrong, const std::string& detail = {}) {
    is_wrong ? Begin(code, detail) : End(code);
  }
  // What the latest part has to complain of: alarms of parts before it that it has not are over.
  void SetOfPart(const std::vector<std::pair<AlarmCode, std::string>>& now);
  // Somebody has seen them: those end whose cause is over.
  void Acknowledge();

  bool IsActive(AlarmCode code) const;
  // The most severe first, the oldest of these first: it is most likely the cause of the others.
  std::vector<Alarm> Active() const;
  std::vector<Alarm> Recent() const;  // that have ended, the newest last
  // How often the code began.
  std::uint64_t Count(AlarmCode code) const;

 private:
  void BeginNow(AlarmCode code, const std::string& detail);
  void EndAt(std::size_t at);

  const Clock unix_ms_;
  const Listener listener_;
  mutable std::mutex mutex_;  // of all below
  std::vector<Alarm> active_;
  std::deque<Alarm> recent_;
  std::vector<std::pair<AlarmCode, std::uint64_t>> counts_;
};

}  // namespace bendloop::host
