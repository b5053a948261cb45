// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <mutex>
#include <optional>
#include <string>

#include "firmware-host/cell/bender_desk.h"
#include "hal/cell_report.h"
#include "hal/clock.h"

namespace bendloop::host {

// What the PLC is to read of the cell, on its way there: whoever knows news sets them, whoever
// follows the bender writes them, between two exchanges of others. A PLC that does not take them
// is tried again after a second, doubling to a minute.
class PlcReporter {
 public:
  explicit PlcReporter(const hal::Clock& clock) : clock_(clock) {}

  // The heartbeat is the reporter's own.
  void Set(const hal::CellReport& report);
  // Something was set since the last call of this.
  bool TakeChanged();
  // Writes what is due; the bender was heard just now.
  void Write(BenderDesk& desk);
  // Why the PLC did not take it; empty: it did.
  std::string problem() const;

 private:
  const hal::Clock& clock_;
  mutable std::mutex mutex_;  // of all below
  std::optional<hal::CellReport> report_;
  bool changed_ = false;  // for TakeChanged
  bool due_ = false;      // for Write
  std::uint32_t heartbeat_ = 0;
  std::chrono::nanoseconds beat_at_{0};
  std::chrono::nanoseconds again_at_{0};
  std::chrono::nanoseconds pause_{0};
  std::string problem_;
};

}  // namespace bendloop::host
