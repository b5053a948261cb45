// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "firmware-host/alarms/alarm_table.h"
#include "firmware-host/result/run_result.h"
#include "hal/error.h"
#include "pipeline/correction/interlocks.h"

namespace bendloop::host {

using RaisedAlarms = std::vector<std::pair<AlarmCode, std::string>>;

// Of an interlock that did not pass.
AlarmCode AlarmOf(pipeline::InterlockKind kind);

// What a part that was decided has to complain of, each with its detail.
RaisedAlarms AlarmsOf(const RunResult& result);
// The same of a scan that led to no measurement.
RaisedAlarms AlarmsOf(const std::string& session, const hal::Error& why);

}  // namespace bendloop::host
