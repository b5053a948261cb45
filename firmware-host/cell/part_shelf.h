// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "config/cell_config.h"
#include "firmware-host/alarms/alarm_table.h"
#include "firmware-host/cell/part_plan.h"
#include "hal/clock.h"

namespace bendloop::host {

// The parts that the cell may be set to: its own, and those of its parts_dir. A part's file is read
// when its number is set for the first time, and not again.
class PartShelf {
 public:
  // `own` is the plan of the cell file's part; `clock` outlives the shelf.
  PartShelf(config::CellConfig cell, std::shared_ptr<const PartPlan> own, const hal::Clock& clock)
      : cell_(std::move(cell)), own_(std::move(own)), clock_(clock) {}

  // `part` is empty where there is no such part: then `alarm` and `detail` say why.
  struct Choice {
    std::shared_ptr<const PartPlan> part;
    AlarmCode alarm = AlarmCode::kUnknownPart;
    std::string detail;
  };
  // 0: the cell file's own.
  const Choice& Select(std::uint32_t number);

 private:
  Choice Find(std::uint32_t number) const;

  const config::CellConfig cell_;
  const std::shared_ptr<const PartPlan> own_;
  const hal::Clock& clock_;
  std::map<std::uint32_t, Choice> known_;
  Choice last_;  // what could not be found, until it is looked for again
  std::optional<std::uint32_t> missing_;
  std::chrono::nanoseconds looked_at_{0};
};

}  // namespace bendloop::host
