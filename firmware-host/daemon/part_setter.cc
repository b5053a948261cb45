// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/part_setter.h"

#include <spdlog/spdlog.h>

namespace bendloop::host {

bool PartSetter::Set(const hal::PlcOrders& orders) {
  PartShelf::Choice choice = shelf_.Select(orders.part_number.value_or(0));
  if (choice.part) {
    if (auto taken = keeper_.TakeUp(*choice.part); !taken) {
      choice = {nullptr, AlarmCode::kUnknownPart, taken.error().message};
    }
  }
  for (const AlarmCode code : {AlarmCode::kUnknownPart, AlarmCode::kAmbiguousPart}) {
    alarms_.Set(code, !choice.part && choice.alarm == code, choice.detail);
  }
  problem_ = choice.detail;
  if (choice.part == set_) return false;
  set_ = choice.part;
  if (set_) {
    spdlog::info("part {} is set: '{}', {} bends, settings {}", set_->part_number, set_->part,
                 set_->nominal.bend_count(), set_->config_digest);
  }
  return true;
}

hal::Result<PartSetter::Part> PartSetter::Of(std::uint32_t number) {
  if (number == 0) return set_ ? set_ : own_;
  const PartShelf::Choice choice = shelf_.Select(number);
  if (!choice.part) return hal::Fail(hal::ErrorKind::kBadInput, choice.detail);
  if (auto taken = keeper_.TakeUp(*choice.part); !taken) return hal::Fail(taken.error());
  return choice.part;
}

hal::Result<PartSetter::Part> PartSetter::OfScan(const hal::PlcOrders& orders) {
  Set(orders);
  if (!set_) return hal::Fail(hal::ErrorKind::kRefused, problem_);
  scanned_ = set_;
  return set_;
}

}  // namespace bendloop::host
