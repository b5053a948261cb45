// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "firmware-host/alarms/alarm_board.h"
#include "firmware-host/cell/part_shelf.h"
#include "firmware-host/daemon/part_keeper.h"
#include "hal/cell_report.h"
#include "hal/result.h"

namespace bendloop::host {

// Which part the cell is set to, by what the PLC says: its plan, with its lot taken up. From the
// cell's thread.
class PartSetter {
 public:
  using Part = std::shared_ptr<const PartPlan>;

  // The keeper and the board outlive it.
  PartSetter(const config::CellConfig& cell, Part own, const hal::Clock& clock, PartKeeper& keeper,
             AlarmBoard& alarms)
      : own_(std::move(own)),
        set_(own_),
        scanned_(own_),
        shelf_(cell, own_, clock),
        keeper_(keeper),
        alarms_(alarms) {}

  // True: it is another part than before. What is not known is an alarm.
  bool Set(const hal::PlcOrders& orders);
  // The part of the scan that begins; kRefused where it is not known.
  hal::Result<Part> OfScan(const hal::PlcOrders& orders);

  // The part that a setter means: 0 for the one that shown() is; kBadInput where there is none.
  hal::Result<Part> Of(std::uint32_t number);

  const PartPlan& own() const { return *own_; }
  bool is_known() const { return set_ != nullptr; }
  std::uint32_t number() const { return set_ ? set_->part_number : 0; }  // 0: it is not known
  // For people: the part that is set, else the cell file's own.
  const PartPlan& shown() const { return set_ ? *set_ : *own_; }
  const PartPlan& scanned() const { return *scanned_; }  // of the latest scan that had one

 private:
  const Part own_;
  Part set_;
  Part scanned_;
  PartShelf shelf_;
  PartKeeper& keeper_;
  AlarmBoard& alarms_;
  std::string problem_;
};

}  // namespace bendloop::host
