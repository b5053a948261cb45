// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/shift_log.h"

#include <algorithm>
#include <cstdio>
#include <span>

namespace bendloop::host {
namespace {

// Latencies of more parts than a shift has; those after them are not counted.
constexpr std::size_t kMostParts = 100'000;

std::string Fraction(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f", value);
  return text;
}

void Field(std::string& line, const char* name, const std::string& value) {
  line += std::string(" ") + name + "=" + value;
}

void Field(std::string& line, const char* name, std::uint64_t value) {
  Field(line, name, std::to_string(value));
}

}  // namespace

std::string ShiftLog::Latency::Text(const char* name) {
  if (ms.empty()) return "";
  std::sort(ms.begin(), ms.end());
  return " " + std::string(name) + "_ms_p50=" + Fraction(ms[ms.size() / 2]) + " " + name +
         "_ms_max=" + Fraction(ms.back());
}

void ShiftLog::PartDone(const std::string& verdict, bool is_corrected, double lra_ms,
                        double end_ms) {
  ++parts_;
  ++verdicts_[verdict.empty() ? "not_judged" : verdict];
  if (is_corrected) ++corrected_;
  if (lra_.ms.size() >= kMostParts) return;
  if (lra_ms > 0) lra_.ms.push_back(static_cast<float>(lra_ms));
  if (end_ms > 0) end_.ms.push_back(static_cast<float>(end_ms));
}

bool ShiftLog::IsIdle(const AlarmBoard& alarms) const {
  if (parts_ > 0 || !alarms.Active().empty()) return false;
  const std::span<const AlarmKind> kinds = AlarmTable();
  return std::none_of(kinds.begin(), kinds.end(), [&](const AlarmKind& kind) {
    const auto before = alarms_before_.find(kind.code);
    return alarms.Count(kind.code) > (before == alarms_before_.end() ? 0 : before->second);
  });
}

std::string ShiftLog::Take(std::chrono::nanoseconds now, const CellSnapshot& cell,
                           const AlarmBoard& alarms) {
  const double hours = std::chrono::duration<double, std::ratio<3600>>(now - began_).count();
  std::string line = "shift";
  Field(line, "hours", Fraction(hours));
  Field(line, "parts", parts_);
  for (const char* verdict : {"pass", "fail", "undecided", "not_judged"}) {
    Field(line, verdict, verdicts_[verdict]);
  }
  Field(line, "corrected", corrected_);
  line += lra_.Text("lra") + end_.Text("end");
  std::string raised;
  for (const AlarmKind& kind : AlarmTable()) {
    const std::uint64_t count = alarms.Count(kind.code);
    std::uint64_t& before = alarms_before_[kind.code];
    if (count > before) {
      raised +=
          (raised.empty() ? "" : ",") + CodeText(kind.code) + ":" + std::to_string(count - before);
    }
    before = count;
  }
  Field(line, "alarms", raised.empty() ? "none" : raised);
  Field(line, "active", alarms.Active().size());
  const std::uint64_t lost = cell.recorder_dropped + cell.recorder_dropped_events;
  Field(line, "sessions_mb", cell.disk_used_mb);
  Field(line, "free_mb", cell.disk_free_mb);
  Field(line, "removed_sessions",
        cell.removed_sessions - std::min(removed_before_, cell.removed_sessions));
  Field(line, "not_recorded", lost - std::min(lost_before_, lost));
  *this = ShiftLog(length_, now);
  for (const AlarmKind& kind : AlarmTable()) alarms_before_[kind.code] = alarms.Count(kind.code);
  removed_before_ = cell.removed_sessions;
  lost_before_ = lost;
  return line;
}

}  // namespace bendloop::host
