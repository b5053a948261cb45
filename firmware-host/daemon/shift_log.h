// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "firmware-host/alarms/alarm_board.h"
#include "firmware-host/cell/cell_status.h"

namespace bendloop::host {

// What the appliance did in a shift, for the log: one line of fields, so that a month of a cell can
// be read without a keyboard. From one thread.
class ShiftLog {
 public:
  // `length` 0: never due. By a clock that nobody sets.
  ShiftLog(std::chrono::nanoseconds length, std::chrono::nanoseconds now)
      : length_(length), began_(now) {}

  // `verdict` as in LastPart, "" when the scan was not measured; of the last profile to the LRA and
  // to the bender's answer.
  void PartDone(const std::string& verdict, bool is_corrected, double lra_ms, double end_ms);

  bool IsDue(std::chrono::nanoseconds now) const {
    return length_.count() > 0 && now - began_ >= length_;
  }
  // Nothing was done, and nothing was or is wrong.
  bool IsIdle(const AlarmBoard& alarms) const;
  // "shift hours=8.0 parts=412 pass=400 ...", and begins a new one. Of a shift without a part, too:
  // a month of silence would not tell a cell at rest from one whose scanner is dead.
  std::string Take(std::chrono::nanoseconds now, const CellSnapshot& cell,
                   const AlarmBoard& alarms);

 private:
  struct Latency {
    std::vector<float> ms;  // of each part
    std::string Text(const char* name);
  };

  std::chrono::nanoseconds length_;
  std::chrono::nanoseconds began_;
  std::uint64_t parts_ = 0;
  std::uint64_t corrected_ = 0;
  std::map<std::string, std::uint64_t> verdicts_;
  Latency lra_;
  Latency end_;
  // As they were when the shift began.
  std::map<AlarmCode, std::uint64_t> alarms_before_;
  std::uint64_t removed_before_ = 0;
  std::uint64_t lost_before_ = 0;
};

}  // namespace bendloop::host
