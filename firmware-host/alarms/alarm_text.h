// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "firmware-host/alarms/alarm_board.h"
#include "firmware-host/result/json.h"

namespace bendloop::host {

// `alarm=BL1001 event=began severity=fault text="..." detail="..." mend="..."`: a line of the log
// whose fields a program can take apart (logfmt).
std::string LogLine(const Alarm& alarm);

// Adds `alarms` (active, the most severe first) and `alarms_ended` (the newest first) to /status.
void ShowAlarms(const AlarmBoard& board, Json& status);
// Of /status, for `bendloop status`: one active alarm a line.
std::string AlarmLines(const Json& status);
// Prometheus text: bendloop_alarm_active and bendloop_alarms_total, by code.
std::string AlarmMetrics(const AlarmBoard& board);

}  // namespace bendloop::host
