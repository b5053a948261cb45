// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/alarms/alarm_text.h"

#include <algorithm>

#include "firmware-host/ledger/moment.h"

namespace bendloop::host {
namespace {

// The newest of those that have ended; more stand in the history.
constexpr std::size_t kShownEnded = 8;

std::string Quoted(const std::string& text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') quoted += '\\';
    quoted += c;
  }
  return quoted + '"';
}

Json AlarmJson(const Alarm& alarm) {
  const AlarmKind& kind = KindOf(alarm.code);
  Json json = {{"code", CodeText(alarm.code)},
               {"severity", Name(kind.severity)},
               {"text", kind.sentence},
               {"detail", alarm.detail},
               {"mend", kind.mend},
               {"began", UtcText(alarm.began_ms)}};
  if (!alarm.is_active()) json["ended"] = UtcText(alarm.ended_ms);
  return json;
}

}  // namespace

std::string LogLine(const Alarm& alarm) {
  const AlarmKind& kind = KindOf(alarm.code);
  std::string line = "alarm=" + CodeText(alarm.code) +
                     " event=" + (alarm.is_active() ? "began" : "ended") +
                     " severity=" + Name(kind.severity) + " text=" + Quoted(kind.sentence);
  if (!alarm.is_active()) return line + " began=" + UtcText(alarm.began_ms);
  if (!alarm.detail.empty()) line += " detail=" + Quoted(alarm.detail);
  return line + " mend=" + Quoted(kind.mend);
}

void ShowAlarms(const AlarmBoard& board, Json& status) {
  Json active = Json::array();
  for (const Alarm& alarm : board.Active()) active.push_back(AlarmJson(alarm));
  Json ended = Json::array();
  const std::vector<Alarm> recent = board.Recent();
  for (auto it = recent.rbegin(); it != recent.rend() && ended.size() < kShownEnded; ++it) {
    ended.push_back(AlarmJson(*it));
  }
  status["alarms"] = std::move(active);
  status["alarms_ended"] = std::move(ended);
}

std::string AlarmLines(const Json& status) {
  std::string lines;
  const auto alarms = status.find("alarms");
  if (alarms == status.end() || !alarms->is_array()) return lines;
  for (const Json& alarm : *alarms) {
    const std::string detail = alarm.value("detail", "");
    lines += "alarm " + alarm.value("code", "") + " (" + alarm.value("severity", "") + ", since " +
             alarm.value("began", "") + "): " + alarm.value("text", "") +
             (detail.empty() ? "" : " (" + detail + ")") + "; " + alarm.value("mend", "") + "\n";
  }
  return lines;
}

std::string AlarmMetrics(const AlarmBoard& board) {
  std::string active =
      "# HELP bendloop_alarm_active 1 while the alarm lasts.\n"
      "# TYPE bendloop_alarm_active gauge\n";
  std::string total =
      "# HELP bendloop_alarms_total How often the alarm began.\n"
      "# TYPE bendloop_alarms_total counter\n";
  for (const AlarmKind& kind : AlarmTable()) {
    const std::string labels =
        "{code=\"" + CodeText(kind.code) + "\",severity=\"" + Name(kind.severity) + "\"} ";
    active += "bendloop_alarm_active" + labels + (board.IsActive(kind.code) ? "1\n" : "0\n");
    total += "bendloop_alarms_total" + labels + std::to_string(board.Count(kind.code)) + "\n";
  }
  return active + total;
}

}  // namespace bendloop::host
