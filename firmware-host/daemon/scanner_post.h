// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <functional>
#include <string>

#include "config/cell_config.h"
#include "firmware-host/acquisition/acquisition.h"
#include "firmware-host/alarms/alarm_board.h"
#include "firmware-host/cell/cell_loop.h"
#include "firmware-host/cell/cell_status.h"
#include "firmware-host/daemon/service_notify.h"
#include "hal/clock.h"

namespace bendloop::host {

// What the cell file asks of the kernel.
RealtimePolicy RealtimeOf(const config::RealtimeConfig& from);

// Keeps the cell's scanner at work: opens it, has the loop serve it, and tries again while it is
// away.
class ScannerPost {
 public:
  // All outlive it.
  ScannerPost(const config::CellConfig& cell, hal::Clock& clock, AlarmBoard& alarms,
              ServiceNotify& notify, StatusBoard& board)
      : cell_(cell), clock_(clock), alarms_(alarms), notify_(notify), board_(board) {}

  // Opens the scanner and runs the loop on it until one of them ends. False: stop.
  bool Serve(CellLoop& loop);
  // Longer each time that the scanner was away, while the loop tends to what needs no scanner.
  void WaitForRetry(CellLoop& loop, const std::function<bool()>& ends);
  // Why Serve said that it is over.
  int exit_code() const { return exit_code_; }

 private:
  bool ServeOne(CellLoop& loop);
  static constexpr std::chrono::milliseconds kFirstRetry{100};
  static constexpr std::chrono::milliseconds kLongestRetry{5000};

  // What Serve returns.
  bool IsAway(const std::string& why);
  bool GiveUp(const hal::Error& error);
  void IsThere(const hal::SourceInfo& info, const Acquisition& acquisition,
               const ProfileRing& ring);

  const config::CellConfig& cell_;
  hal::Clock& clock_;
  AlarmBoard& alarms_;
  ServiceNotify& notify_;
  StatusBoard& board_;
  std::chrono::milliseconds retry_ = kFirstRetry;
  std::string problem_;
  int exit_code_ = 0;
};

}  // namespace bendloop::host
