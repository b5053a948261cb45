// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <string>

#include "firmware-host/alarms/alarm_board.h"
#include "firmware-host/cell/cell_loop.h"
#include "firmware-host/cell/cell_status.h"
#include "firmware-host/cell/part_run.h"
#include "hal/cell_report.h"

namespace bendloop::host {

// Of the last tube's judgement, for whoever sorts tubes: held where the measurement, or which part
// it is of, is not to be trusted.
hal::TubeVerdict VerdictOf(const RunResult& result);
// The worst deviation of lengths, rotations and angles, in percent of its tolerance.
std::uint32_t WorstPercent(const RunResult& result);

// The cell's contract with the PLC: what it says, taken once each, and what it reads. Any thread.
class PlcDesk {
 public:
  explicit PlcDesk(AlarmBoard& alarms) : alarms_(alarms) {}

  // What it says now. True: it acknowledges, once.
  bool Heard(const hal::PlcOrders& orders);
  void Acknowledged();  // is done
  bool holds() const;
  // It asks for a new lot, which has not been begun yet.
  bool AsksForLot() const;
  void LotBegun();

  // The result is on disk.
  void Done(const PartOutcome& outcome);
  void Failed(const FailedScan& failed, std::uint32_t part_number);

  // `part_set`: of the next scan; 0: it is not known. `is_held`: no program is changed.
  hal::CellReport Report(CellPhase phase, std::uint32_t part_set, bool is_held) const;

 private:
  void Count(const std::string& session, hal::TubeVerdict verdict);

  AlarmBoard& alarms_;
  mutable std::mutex mutex_;  // of all below
  bool has_heard_ = false;
  hal::PlcOrders orders_;
  hal::CellReport report_;
  std::string counted_;  // the session that was counted last
};

}  // namespace bendloop::host
