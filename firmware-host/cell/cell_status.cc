// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/cell_status.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "firmware-host/alarms/alarm_text.h"
#include "firmware-host/console/version.h"
#include "firmware-host/result/program_json.h"

namespace bendloop::host {

const char* Name(CellPhase phase) {
  switch (phase) {
    case CellPhase::kStarting:
      return "starting";
    case CellPhase::kNoScanner:
      return "no scanner";
    case CellPhase::kWaiting:
      return "waiting for a scan";
    case CellPhase::kScanning:
      return "scanning";
    case CellPhase::kDeciding:
      return "deciding";
    case CellPhase::kCommitting:
      return "committing";
    case CellPhase::kStopping:
      break;
  }
  return "stopping";
}

const char* Name(hal::BenderMode mode) {
  switch (mode) {
    case hal::BenderMode::kNotReady:
      return "not ready";
    case hal::BenderMode::kIdle:
      return "idle";
    case hal::BenderMode::kBending:
      return "bending";
    case hal::BenderMode::kFault:
      break;
  }
  return "fault";
}

void ShowAcquisition(const AcquisitionCounters& counters, const ProfileRing& ring,
                     CellSnapshot& s) {
  s.profiles = counters.profiles;
  s.points = counters.points;
  s.dropped_profiles = counters.dropped_profiles;
  s.missing_profiles = counters.missing_profiles;
  s.dropped_events = counters.dropped_events;
  s.repeated_profiles = counters.repeated_profiles;
  s.reordered_profiles = counters.reordered_profiles;
  s.queue_now = ring.Filled();
  s.queue_peak = counters.queue_peak;
  s.queue_capacity = ring.capacity();
  s.lateness_last_ms = static_cast<double>(counters.lateness_last_ns) * 1e-6;
  s.lateness_peak_ms = static_cast<double>(counters.lateness_peak_ns) * 1e-6;
  const double drift_ppm = counters.clock_drift_ppm;
  s.clock_drift_ppm = std::isnan(drift_ppm) ? std::nullopt : std::optional<double>(drift_ppm);
}

void ShowRecorder(const RecorderCounters& counters, CellSnapshot& s) {
  s.recorded_sessions = counters.sessions;
  s.recorder_dropped = counters.dropped_profiles;
  s.recorder_dropped_events = counters.dropped_events;
  s.recorder_dropped_sessions = counters.dropped_sessions;
  s.recorder_error = counters.last_error;
  s.recorder_waiting_points = counters.queued_points;
  s.removed_sessions = counters.removed_sessions;
  s.disk_used_mb = counters.sessions_bytes >> 20;
  s.disk_free_mb = counters.free.bytes >> 20;
  s.disk_free_names = counters.free.names;
  s.knows_disk = counters.knows_disk;
}

std::string ProgressLine(const pipeline::LiveView& view, double nominal_length_mm) {
  char text[160];
  std::string line;
  if (const std::size_t bends = view.program.bend_count(); bends > 0) {
    std::snprintf(text, sizeof text, "bend %zu seen, %.1f +- %.1f degree; ", bends,
                  view.program.rows[bends - 1].angle_deg, view.sigma.rows[bends - 1].angle_deg);
    line = text;
  } else {
    line = "no bend seen; ";
  }
  const double missing_mm = std::max(0.0, nominal_length_mm - view.covered_mm);
  // The ends are seen to a pipe radius or so: less is not missing.
  if (missing_mm < 2 * view.pipe_radius_mm) {
    std::snprintf(text, sizeof text, "%.0f mm of %.0f seen", nominal_length_mm, nominal_length_mm);
  } else {
    std::snprintf(text, sizeof text, "%.0f mm of %.0f still missing", missing_mm,
                  nominal_length_mm);
  }
  return line + text;
}

// A table. NOLINTNEXTLINE(readability-function-size)
Json StatusJson(const CellSnapshot& s) {
  Json json = {{"schema", "bendloop.status/1"},
               {"software", kSoftware},
               {"cell", s.cell},
               {"part", s.part},
               {"state", Name(s.phase)},
               {"scanner", s.scanner},
               {"bender",
                {{"address", s.bender},
                 {"state", s.bender_state},
                 {"active_sequence", s.bender_sequence},
                 {"parts_bent", s.bender_parts_bent}}},
               {"parts",
                {{"done", s.parts},
                 {"corrected", s.corrected},
                 {"refused", s.refused},
                 {"repeats", s.repeats},
                 {"failed_scans", s.failed_scans}}},
               {"health",
                {{"profiles", s.profiles},
                 {"points", s.points},
                 {"dropped_profiles", s.dropped_profiles},
                 {"missing_profiles", s.missing_profiles},
                 {"dropped_events", s.dropped_events},
                 {"repeated_profiles", s.repeated_profiles},
                 {"reordered_profiles", s.reordered_profiles},
                 {"silences", s.silences},
                 {"queue_now", s.queue_now},
                 {"queue_peak", s.queue_peak},
                 {"queue_capacity", s.queue_capacity},
                 {"lateness_last_ms", Number(s.lateness_last_ms, 3)},
                 {"lateness_peak_ms", Number(s.lateness_peak_ms, 3)},
                 {"clock_drift_ppm", s.clock_drift_ppm ? Number(*s.clock_drift_ppm, 2) : Json()},
                 {"lra_last_ms", Number(s.last_lra_ms, 3)},
                 {"lra_peak_ms", Number(s.peak_lra_ms, 3)},
                 {"answer_last_ms", Number(s.last_end_ms, 3)},
                 {"answer_peak_ms", Number(s.peak_end_ms, 3)},
                 {"decision_last_ms", Number(s.last_decision_ms, 3)},
                 {"decision_peak_ms", Number(s.peak_decision_ms, 3)},
                 {"recorded_sessions", s.recorded_sessions},
                 {"recorder_dropped_profiles", s.recorder_dropped},
                 {"recorder_dropped_events", s.recorder_dropped_events},
                 {"recorder_dropped_sessions", s.recorder_dropped_sessions},
                 {"recorder_waiting_points", s.recorder_waiting_points},
                 {"recorder_error", s.recorder_error},
                 {"removed_sessions", s.removed_sessions},
                 {"disk_used_mb", s.disk_used_mb},
                 {"disk_free_mb", s.disk_free_mb}}}};
  if (!s.problem.empty()) json["problem"] = s.problem;
  json["lot"] = {{"number", s.lot.number},
                 {"parts", s.lot.parts},
                 {"held", s.lot.held},
                 {"temperament", s.lot.temperament}};
  if (!s.session.empty()) {
    json["scan"] = {{"session", s.session},
                    {"profiles", s.live.profiles},
                    {"points", s.live.points},
                    {"progress", ProgressLine(s.live, s.nominal_length_mm)},
                    {"covered_mm", Number(s.live.covered_mm, 3)},
                    {"nominal_mm", Number(s.nominal_length_mm, 3)},
                    {"pipe_radius_mm", Number(s.live.pipe_radius_mm, 3)},
                    {"rows", RowsJson(s.live.program)},
                    {"sigma_rows", SigmaRowsJson(s.live.sigma, s.live.program)}};
  }
  if (s.last) {
    json["last_part"] = {{"session", s.last->session},
                         {"end", s.last->end},
                         {"verdict", s.last->verdict},
                         {"reason", s.last->reason},
                         {"notices", s.last->notices},
                         {"forecast", s.last->forecast ? Number(*s.last->forecast, 4) : Json()}};
    if (const auto& pass = s.last->furthest_pass) {
      json["last_part"]["passes_apart_mm"] = Number(pass->moved_mm, 3);
      json["last_part"]["passes_apart_deg"] = Number(pass->turned_deg, 3);
    }
  }
  return json;
}

namespace {

void AppendLines(const Json& json, const std::string& prefix, std::string& text) {
  for (const auto& [key, value] : json.items()) {
    if (value.is_object()) {
      AppendLines(value, prefix + key + " ", text);
      continue;
    }
    if (value.is_array() || key == "schema") continue;
    std::string name = prefix + key;
    for (char& c : name) {
      if (c == '_') c = ' ';
    }
    name.resize(std::max<std::size_t>(name.size() + 1, 34), ' ');
    text += name + (value.is_string() ? value.get<std::string>() : value.dump()) + "\n";
  }
}

}  // namespace

std::string StatusText(const Json& status) {
  std::string text = AlarmLines(status);
  AppendLines(status, "", text);
  return text;
}

// A table. NOLINTNEXTLINE(readability-function-size)
std::string MetricsText(const CellSnapshot& s) {
  std::string text;
  const auto metric = [&text](const char* name, const char* type, const char* help, double value) {
    char line[64];
    std::snprintf(line, sizeof line, "%.17g", value);
    text += std::string("# HELP bendloop_") + name + " " + help + "\n# TYPE bendloop_" + name +
            " " + type + "\nbendloop_" + name + " " + line + "\n";
  };
  const auto number = [](std::uint64_t value) { return static_cast<double>(value); };
  metric("up", "gauge", "1 while the scanner is connected.",
         s.phase == CellPhase::kStarting || s.phase == CellPhase::kNoScanner ? 0 : 1);
  metric("profiles_total", "counter", "Laser profiles received.", number(s.profiles));
  metric("points_total", "counter", "Points received.", number(s.points));
  metric("dropped_profiles_total", "counter", "Profiles dropped because the ring was full.",
         number(s.dropped_profiles));
  metric("missing_profiles_total", "counter", "Profiles missing in the scanner's own count.",
         number(s.missing_profiles));
  metric("repeated_profiles_total", "counter", "Profiles that came twice in a row.",
         number(s.repeated_profiles));
  metric("reordered_profiles_total", "counter", "Profiles that came after a later one.",
         number(s.reordered_profiles));
  metric("dropped_events_total", "counter", "Events dropped because the ring was full.",
         number(s.dropped_events));
  metric("silences_total", "counter", "Times the scanner fell silent in a scan.",
         number(s.silences));
  metric("queue_profiles", "gauge", "Profiles that wait in the ring.", number(s.queue_now));
  metric("queue_peak_profiles", "gauge", "Most profiles that waited in the ring.",
         number(s.queue_peak));
  metric("queue_capacity_profiles", "gauge", "Profiles that fit in the ring.",
         number(s.queue_capacity));
  metric("lateness_last_seconds", "gauge", "Delay of the latest profile beyond the quickest.",
         s.lateness_last_ms * 1e-3);
  metric("lateness_peak_seconds", "gauge", "Largest delay of a profile beyond the quickest.",
         s.lateness_peak_ms * 1e-3);
  if (s.clock_drift_ppm) {
    metric("scanner_clock_drift_ratio", "gauge", "How much faster the scanner's clock runs.",
           *s.clock_drift_ppm * 1e-6);
  }
  metric("parts_total", "counter", "Parts finished.", number(s.parts));
  metric("parts_corrected_total", "counter", "Parts that led to a corrected program.",
         number(s.corrected));
  metric("parts_refused_total", "counter", "Parts whose correction was refused.",
         number(s.refused));
  metric("failed_scans_total", "counter", "Scans that gave no measurement.",
         number(s.failed_scans));
  metric("lra_last_seconds", "gauge", "Last profile to the final LRA.", s.last_lra_ms * 1e-3);
  metric("lra_peak_seconds", "gauge", "Longest last profile to the final LRA.",
         s.peak_lra_ms * 1e-3);
  metric("answer_last_seconds", "gauge", "Last profile to the bender's answer.",
         s.last_end_ms * 1e-3);
  metric("answer_peak_seconds", "gauge", "Longest last profile to the bender's answer.",
         s.peak_end_ms * 1e-3);
  metric("decision_last_seconds", "gauge", "Last scan's end to the bender's answer.",
         s.last_decision_ms * 1e-3);
  metric("decision_peak_seconds", "gauge", "Longest scan's end to the bender's answer.",
         s.peak_decision_ms * 1e-3);
  metric("recorder_dropped_profiles_total", "counter", "Profiles left out of recordings.",
         number(s.recorder_dropped));
  metric("recorder_dropped_events_total", "counter", "Events left out of recordings.",
         number(s.recorder_dropped_events));
  metric("recorder_dropped_sessions_total", "counter", "Scans that were not recorded at all.",
         number(s.recorder_dropped_sessions));
  metric("recorder_waiting_points", "gauge", "Points that wait for the disk.",
         number(s.recorder_waiting_points));
  metric("removed_sessions_total", "counter", "Sessions removed for the disk budget.",
         number(s.removed_sessions));
  metric("disk_used_bytes", "gauge", "Taken by sessions.", number(s.disk_used_mb << 20));
  metric("disk_free_bytes", "gauge", "Free where sessions go.", number(s.disk_free_mb << 20));
  const pipeline::PassBeside pass =
      s.last ? s.last->furthest_pass.value_or(pipeline::PassBeside{}) : pipeline::PassBeside{};
  metric("passes_apart_mm", "gauge", "How far a pass of the last scan lay beside the others.",
         pass.moved_mm);
  metric("passes_apart_degrees", "gauge", "How far it was turned against them.", pass.turned_deg);
  metric("scan_covered_mm", "gauge", "Spine that the running scan has seen.",
         s.session.empty() ? 0 : s.live.covered_mm);
  return text;
}

}  // namespace bendloop::host
