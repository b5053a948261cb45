// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "hal/cell_report.h"

namespace bendloop::host {

// What the PLC says of the scan that runs: whether it may run, and when it is over. A PLC that says
// nothing of scans allows all, and ends none.
class ScanPermit {
 public:
  // A scan begins; `orders` as they are now.
  void Begin(const hal::PlcOrders& orders) {
    was_allowed_ = orders.scan == hal::ScanOrder::kMayRun;
    may_run_ = orders.scan != hal::ScanOrder::kOver;
    is_over_ = false;
  }
  // While it runs. It is over only after it was allowed: an older look may still say what was
  // before.
  void Heard(const hal::PlcOrders& orders) {
    if (!orders.scan) return;
    if (*orders.scan == hal::ScanOrder::kMayRun) may_run_ = true;
    is_over_ = is_over_ || (may_run_ && was_allowed_ && *orders.scan == hal::ScanOrder::kOver);
    was_allowed_ = was_allowed_ || *orders.scan == hal::ScanOrder::kMayRun;
  }

  bool may_run() const { return may_run_; }
  bool is_over() const { return is_over_; }

 private:
  bool was_allowed_ = false;
  bool may_run_ = true;
  bool is_over_ = false;
};

}  // namespace bendloop::host
