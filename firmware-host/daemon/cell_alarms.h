// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <mutex>
#include <string>
#include <vector>

#include "firmware-host/alarms/alarm_board.h"
#include "firmware-host/alarms/part_alarms.h"
#include "firmware-host/cell/bender_desk.h"
#include "firmware-host/cell/cell_status.h"

namespace bendloop::host {

// The cell's alarms: what the daemon sees becomes one or ends one, the log hears of it at once, and
// the history at leisure. Any thread may call.
class CellAlarms {
 public:
  CellAlarms();

  AlarmBoard& board() { return board_; }
  const AlarmBoard& board() const { return board_; }

  // What the bender said; `part_number` is the cell's.
  void BenderHeard(const BenderReading& heard, std::uint32_t part_number);
  // Counters that rise and disks that fill: a few times a second.
  void Look(const CellSnapshot& cell);
  // A part was decided, or its scan failed; all that is not in `complaints` is over.
  void PartDone(RaisedAlarms complaints, const CellSnapshot& cell);
  // Beginnings and ends since the last call, for the history; the oldest are left out when nobody
  // came for long.
  std::vector<Alarm> TakeNews();

 private:
  // A counter whose rise is an alarm, until a whole part has gone by without one.
  struct Rising {
    AlarmCode code;
    std::uint64_t last = 0;  // when the latest part was done
  };
  RaisedAlarms Rises(const CellSnapshot& cell, bool part_is_over);
  void LookAtDisk(const CellSnapshot& cell);

  std::mutex mutex_;  // of the news and the counters
  std::deque<Alarm> news_;
  std::array<Rising, 4> rising_{{{AlarmCode::kProfilesLost},
                                 {AlarmCode::kScannerSilent},
                                 {AlarmCode::kRecordingIncomplete},
                                 {AlarmCode::kOutOfMemory}}};
  AlarmBoard board_;
};

}  // namespace bendloop::host
