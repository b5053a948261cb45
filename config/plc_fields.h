// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "hal/register_map.h"

namespace bendloop::config {

// The numbers of a register map's [report] and [orders] with their keys; each may be left out.
using NamedFields = std::vector<std::pair<std::string_view, std::optional<hal::RegisterField>*>>;

inline NamedFields FieldsOf(hal::ReportFields& report) {
  return {{"heartbeat", &report.heartbeat},
          {"state", &report.state},
          {"alarm", &report.alarm},
          {"alarms", &report.alarms},
          {"sequence", &report.sequence},
          {"verdict", &report.verdict},
          {"part_number", &report.part_number},
          {"worst_percent", &report.worst_percent},
          {"tubes", &report.tubes},
          {"passed", &report.passed},
          {"failed", &report.failed},
          {"undecided", &report.undecided},
          {"held", &report.held},
          {"part_set", &report.part_set},
          {"acknowledged", &report.acknowledged},
          {"lot_begun", &report.lot_begun}};
}

inline NamedFields FieldsOf(hal::OrderFields& orders) {
  return {{"part_number", &orders.part_number},
          {"scan", &orders.scan},
          {"hold", &orders.hold},
          {"new_lot", &orders.new_lot},
          {"acknowledge", &orders.acknowledge}};
}

}  // namespace bendloop::config
