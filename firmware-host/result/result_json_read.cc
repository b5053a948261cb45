// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "firmware-host/result/json_reader.h"
#include "firmware-host/result/program_json.h"
#include "firmware-host/result/result_json.h"
#include "firmware-host/result/sections.h"

namespace bendloop::host {
namespace {

constexpr std::size_t kMaxSpine = 1'000'000;

void ReadFit(const JsonReader& json, pipeline::Measurement& m) {
  m.fit.samples = json.At("samples").Count();
  m.fit.outliers = json.At("outliers").Count();
  m.fit.median_abs_distance_mm = json.At("median_abs_distance_mm").Number();
  m.fit.rms_distance_mm = json.At("rms_distance_mm").Number();
  m.fit.p95_abs_distance_mm = json.At("p95_abs_distance_mm").Number();
  m.noise_mm = json.NumberOr("noise_mm", 0);
  m.coverage = json.NumberOr("coverage", 0);
  m.longest_gap_mm = json.NumberOr("longest_gap_mm", 0);
  m.structure_margin = json.NumberOr("structure_margin", std::nan(""));
  m.halves_differ_sigma = json.NumberOr("halves_differ_sigma", std::nan(""));
  if (json.Has("passes")) m.passes = ReadPasses(json.At("passes"));
}

// Rows and bends are checked against the program, since a text names them.
std::size_t ReadIndex(const JsonReader& json, std::size_t count) {
  const std::size_t index = json.Count();
  if (index < count) return index;
  json.Wrong("a row of the tube");
  return 0;
}

pipeline::RowValue ReadRowValue(const JsonReader& json, std::size_t rows) {
  return {ReadIndex(json.At("row"), rows), ReadWord<pipeline::RowValueKind>(json.At("value"))};
}

void ReadJointUncertainty(const JsonReader& json, std::size_t rows,
                          pipeline::JointUncertainty& joint) {
  joint.is_known = json.Has("correlations");
  if (joint.is_known) {
    const JsonReader list = json.At("correlations");
    for (std::size_t i = 0, n = list.Size(pipeline::kMostCorrelations); i < n; ++i) {
      const JsonReader item = list.Item(i);
      joint.correlations.push_back({ReadRowValue(item.At("first"), rows),
                                    ReadRowValue(item.At("second"), rows),
                                    item.At("coefficient").Number()});
    }
  }
  if (!json.Has("known_together")) return;
  const JsonReader list = json.At("known_together");
  for (std::size_t i = 0, n = list.Size(kMaxRows); i < n; ++i) {
    const JsonReader item = list.Item(i);
    pipeline::KnownTogether& run = joint.known_together.emplace_back();
    run.first_bend = ReadIndex(item.At("first_bend"), rows);
    run.last_bend = ReadIndex(item.At("last_bend"), rows);
    const JsonReader values = item.At("values");
    for (std::size_t k = 0, count = values.Size(kMaxRows); k < count; ++k) {
      run.values.push_back(ReadRowValue(values.Item(k), rows));
    }
    run.direction_sigma_deg = item.At("direction_sigma_deg").Number();
    run.plane_sigma_deg = item.At("plane_sigma_deg").Number();
    run.length_mm = item.At("length_mm").Number();
    run.length_sigma_mm = item.At("length_sigma_mm").Number();
  }
}

void ReadMeasurement(const JsonReader& json, pipeline::Measurement& m) {
  const JsonReader tube = json.At("tube");
  m.tube.pipe_radius_mm = tube.At("pipe_radius_mm").Number();
  m.tube.program = ReadRows(tube.At("rows"));
  m.tube.X_WT.position_mm = ReadPoint(tube.At("position_mm"));
  m.tube.X_WT.orientation = ReadOrientation(tube.At("orientation_wxyz"));

  const JsonReader sigma = json.At("uncertainty_1sigma");
  m.pipe_radius_sigma_mm = sigma.NumberOr("pipe_radius_mm", 0);
  m.sigma = ReadRows(sigma.At("rows"));
  if (m.sigma.rows.size() != m.tube.program.rows.size()) {
    sigma.At("rows").Wrong("as many rows as tube/rows");
  }
  ReadJointUncertainty(sigma, m.tube.program.rows.size(), m.joint);
  ReadFit(json.At("fit"), m);
  if (json.Has("bend_shapes")) {
    const JsonReader shapes = json.At("bend_shapes");
    for (std::size_t i = 0, n = shapes.Size(kMaxRows); i < n; ++i) {
      const JsonReader shape = shapes.Item(i);
      m.bend_shapes.push_back(
          {shape.NumberOr("ovality_percent", 0), shape.NumberOr("ovality_sigma_percent", 0),
           shape.NumberOr("outer_wall_mm", 0), shape.NumberOr("outer_wall_sigma_mm", 0)});
    }
  }
  if (json.Has("form")) ReadForm(json.At("form"), m);
  if (json.Has("features")) ReadFeatures(json.At("features"), m);

  if (json.Has("warnings")) m.warnings = json.At("warnings").Texts();
  if (json.Has("spine")) {
    const JsonReader spine = json.At("spine");
    for (std::size_t i = 0, n = spine.Size(kMaxSpine); i < n; ++i) {
      const JsonReader sample = spine.Item(i);
      m.spine.push_back(
          {ReadPoint(sample.At("position_mm")), sample.At("pipe_radius_mm").Number()});
    }
  }
  if (json.Has("timing_ms")) {
    const JsonReader timing = json.At("timing_ms");
    if (!timing.json().is_object()) timing.Wrong("an object of stages");
    for (const auto& [stage, ms] : timing.json().items()) {
      m.timing.push_back({stage, timing.At(stage.c_str()).Number()});
    }
  }
}

}  // namespace

hal::Result<RunResult> ReadResultJson(std::string_view text, std::string_view name) {
  Json root;
  try {
    root = Json::parse(text);
  } catch (const Json::parse_error& error) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     std::string(name) + ": byte " + std::to_string(error.byte) +
                         ": not JSON; expected a bendloop.result/1 document");
  } catch (const Json::out_of_range&) {
    return hal::Fail(
        hal::ErrorKind::kBadInput,
        std::string(name) + ": a number does not fit 64 bits, expected mm and degrees");
  }
  std::optional<hal::Error> error;
  const JsonReader json(root, name, error);
  const std::string schema = json.At("schema").Text();
  if (!error && schema == kFailedScanSchema) {
    return hal::Fail(
        hal::ErrorKind::kBadInput,
        std::string(name) + ": a scan that led to no measurement: " + json.TextOr("error"));
  }
  if (!error && schema != "bendloop.result/1") {
    return hal::Fail(hal::ErrorKind::kBadInput, std::string(name) + "/schema: found \"" + schema +
                                                    "\", expected \"bendloop.result/1\"");
  }
  RunResult result;
  result.part = json.TextOr("part");
  result.session = json.TextOr("session");
  result.time = json.TextOr("time");
  result.software = json.TextOr("software");
  result.identity = json.TextOr("identity");
  result.repeat_of = json.TextOr("repeat_of");
  ReadMeasurement(json, result.measurement);
  if (json.Has("nominal")) result.nominal = ReadRows(json.At("nominal").At("rows"));
  if (json.Has("inspection")) result.inspection = ReadInspection(json.At("inspection"));
  if (json.Has("commanded")) result.commanded = ReadProgramBlock(json.At("commanded"));
  if (json.Has("correction")) result.correction = ReadCorrection(json.At("correction"));
  if (json.Has("interlocks")) result.interlocks = ReadInterlocks(json.At("interlocks"));
  if (json.Has("bender")) result.bender = ReadBender(json.At("bender"));
  if (error) return hal::Fail(*error);
  return result;
}

}  // namespace bendloop::host
