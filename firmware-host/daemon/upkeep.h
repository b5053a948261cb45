// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>

#include "config/cell_config.h"
#include "firmware-host/alarms/alarm_board.h"
#include "firmware-host/cell/bender_desk.h"
#include "firmware-host/cell/cell_status.h"
#include "firmware-host/daemon/clock_watch.h"
#include "firmware-host/daemon/neighbour_watch.h"
#include "firmware-host/daemon/part_keeper.h"
#include "firmware-host/daemon/shift_log.h"
#include "hal/clock.h"

namespace bendloop::host {

// What an appliance does by itself that nobody looks after: what is too old goes from the
// databases, a clock that was set is told, and so are neighbours that take the machine; the log
// says once a shift what was done. All given outlive it; from the cell's thread, between parts.
class Upkeep {
 public:
  Upkeep(const config::StorageConfig& storage, const hal::Clock& clock, AlarmBoard& alarms,
         PartKeeper& keeper, const StatusBoard& board);

  // A few times a second.
  void Do(BenderDesk& desk);
  // A part was decided, or its scan failed.
  void PartDone(const std::string& verdict, bool is_corrected);
  // What the shift that ends with the process has done, if anything.
  void TellLastShift();

 private:
  void TellShift();
  void DropOld(BenderDesk& desk);
  void WatchClock();
  void WatchNeighbours();

  const config::StorageConfig storage_;
  const hal::Clock& clock_;
  AlarmBoard& alarms_;
  PartKeeper& keeper_;
  const StatusBoard& board_;
  ShiftLog shift_;
  std::optional<std::chrono::nanoseconds> drop_due_;  // by clock_
  ClockWatch clock_watch_;
  NeighbourWatch neighbours_;
};

}  // namespace bendloop::host
