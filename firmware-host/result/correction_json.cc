// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/result/program_json.h"
#include "firmware-host/result/sections.h"

namespace bendloop::host {
namespace {

using pipeline::AxisCorrection;
using pipeline::CorrectionFlag;

Json AxisJson(const AxisCorrection& axis) {
  Json flags = Json::array();
  for (const auto& [flag, word] : Words<CorrectionFlag>::kTable) {
    if (axis.flags & flag) flags.push_back(word);
  }
  return {{"commanded", Number(axis.commanded)},
          {"active", Number(axis.active)},
          {"deviation", Number(axis.deviation)},
          {"gain", Number(axis.gain)},
          {"wanted", Number(axis.wanted)},
          {"applied", Number(axis.applied)},
          {"corrected", Number(axis.corrected)},
          {"sigma", Number(axis.sigma)},
          {"flags", flags}};
}

AxisCorrection ReadAxis(const JsonReader& json) {
  AxisCorrection axis;
  axis.commanded = json.At("commanded").Number();
  // Results of before 2026-11 corrected the program that had bent the part.
  axis.active = json.Has("active") ? json.At("active").Number() : axis.commanded;
  axis.deviation = json.At("deviation").Number();
  axis.gain = json.At("gain").Number();
  axis.wanted = json.At("wanted").Number();
  axis.applied = json.At("applied").Number();
  axis.corrected = json.At("corrected").Number();
  axis.sigma = json.At("sigma").Number();
  const JsonReader flags = json.At("flags");
  for (std::size_t i = 0, n = flags.Size(32); i < n; ++i) {
    axis.flags |= ReadWord<CorrectionFlag>(flags.Item(i));
  }
  return axis;
}

Json ForecastJson(const pipeline::Forecast& forecast) {
  Json rows = Json::array();
  for (const pipeline::RowForecast& row : forecast.rows) {
    rows.push_back({{"length", Number(row.length_mm)},
                    {"rotation", Number(row.rotation_deg)},
                    {"angle", Number(row.angle_deg)}});
  }
  return {{"part", Number(forecast.part)}, {"rows", rows}};
}

pipeline::Forecast ReadForecast(const JsonReader& json) {
  pipeline::Forecast forecast;
  forecast.part = json.At("part").Number();
  const JsonReader rows = json.At("rows");
  for (std::size_t i = 0, n = rows.Size(kMaxRows); i < n; ++i) {
    const JsonReader row = rows.Item(i);
    forecast.rows.push_back(
        {row.At("length").Number(), row.At("rotation").Number(), row.At("angle").Number()});
  }
  return forecast;
}

}  // namespace

Json CorrectionJson(const pipeline::Correction& correction) {
  Json rows = Json::array();
  for (const auto& row : correction.rows) {
    rows.push_back({{"length_mm", AxisJson(row.length_mm)},
                    {"rotation_deg", AxisJson(row.rotation_deg)},
                    {"angle_deg", AxisJson(row.angle_deg)}});
  }
  return {
      {"refused", correction.refused()},
      {"changes_anything", correction.changes_anything},
      {"corrected", {{"rows", RowsJson(correction.corrected)}}},
      {"rows", rows},
      {"forecast", correction.forecast.rows.empty() ? Json() : ForecastJson(correction.forecast)},
      {"notices", correction.notices},
      {"refusals", correction.refusals}};
}

pipeline::Correction ReadCorrection(const JsonReader& json) {
  pipeline::Correction correction;
  correction.changes_anything = json.At("changes_anything").Bool();
  correction.corrected = ReadRows(json.At("corrected").At("rows"));
  const JsonReader rows = json.At("rows");
  for (std::size_t i = 0, n = rows.Size(kMaxRows); i < n; ++i) {
    const JsonReader row = rows.Item(i);
    correction.rows.push_back({ReadAxis(row.At("length_mm")), ReadAxis(row.At("rotation_deg")),
                               ReadAxis(row.At("angle_deg"))});
  }
  // Results of before 2026-11-22 forecast nothing.
  if (json.Has("forecast")) correction.forecast = ReadForecast(json.At("forecast"));
  correction.notices = json.At("notices").Texts();
  correction.refusals = json.At("refusals").Texts();
  return correction;
}

Json InterlocksJson(const pipeline::InterlockReport& report) {
  Json checks = Json::array();
  bool passed = true;
  for (const auto& check : report.checks) {
    passed = passed && check.passed;
    checks.push_back({{"name", Word(check.kind)},
                      {"passed", check.passed},
                      {"value", Number(check.value)},
                      {"limit", Number(check.limit)},
                      {"sentence", check.sentence}});
  }
  return {{"passed", passed}, {"checks", checks}};
}

pipeline::InterlockReport ReadInterlocks(const JsonReader& json) {
  pipeline::InterlockReport report;
  const JsonReader checks = json.At("checks");
  for (std::size_t i = 0, n = checks.Size(kMaxRows); i < n; ++i) {
    const JsonReader check = checks.Item(i);
    report.checks.push_back({ReadWord<pipeline::InterlockKind>(check.At("name")),
                             check.At("passed").Bool(), check.At("value").Number(),
                             check.At("limit").Number(), check.At("sentence").Text()});
  }
  return report;
}

}  // namespace bendloop::host
