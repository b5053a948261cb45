// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/result/program_json.h"
#include "firmware-host/result/sections.h"

namespace bendloop::host {
namespace {

using pipeline::Deviation;
using pipeline::ToleranceState;

Json Optional(const std::optional<double>& value) { return value ? Number(*value) : Json(nullptr); }

Json RowsOfDeviations(const std::vector<pipeline::RowInspection>& rows) {
  Json json = Json::array();
  for (const auto& row : rows) {
    json.push_back({{"length_mm", DeviationJson(row.length_mm)},
                    {"rotation_deg", DeviationJson(row.rotation_deg)},
                    {"angle_deg", DeviationJson(row.angle_deg)},
                    {"bend_radius_mm",
                     row.bend_radius_mm ? DeviationJson(*row.bend_radius_mm) : Json(nullptr)}});
  }
  return json;
}

Json EnvelopeJson(const pipeline::Inspection& inspection) {
  Json points = Json::array();
  for (const auto& point : inspection.envelope) {
    points.push_back({{"name", point.name},
                      {"nominal_mm", PointJson(point.nominal_mm)},
                      {"measured_mm", PointJson(point.measured_mm)},
                      {"distance_mm", Number(point.distance_mm)},
                      {"sigma_mm", Number(point.sigma_mm)},
                      {"state", Word(point.state)}});
  }
  return {{"max_mm", Number(inspection.envelope_max_mm)}, {"points", points}};
}

void ReadEnvelope(const JsonReader& json, pipeline::Inspection& inspection) {
  inspection.envelope_max_mm = json.At("max_mm").Number();
  const JsonReader points = json.At("points");
  for (std::size_t i = 0, n = points.Size(100'000); i < n; ++i) {
    const JsonReader point = points.Item(i);
    inspection.envelope.push_back({point.At("name").Text(), ReadPoint(point.At("nominal_mm")),
                                   ReadPoint(point.At("measured_mm")),
                                   point.At("distance_mm").Number(), point.At("sigma_mm").Number(),
                                   ReadWord<ToleranceState>(point.At("state"))});
  }
}

Json SurfaceJson(const pipeline::SurfaceDistances& surface) {
  return {
      {"max_abs_mm", Number(surface.max_abs_mm)},       {"p99_abs_mm", Number(surface.p99_abs_mm)},
      {"p95_abs_mm", Number(surface.p95_abs_mm)},       {"rms_mm", Number(surface.rms_mm)},
      {"tolerance_mm", Optional(surface.tolerance_mm)}, {"state", Word(surface.state)}};
}

void ReadSurface(const JsonReader& json, pipeline::SurfaceDistances& surface) {
  surface.max_abs_mm = json.At("max_abs_mm").Number();
  surface.p99_abs_mm = json.At("p99_abs_mm").Number();
  surface.p95_abs_mm = json.At("p95_abs_mm").Number();
  surface.rms_mm = json.At("rms_mm").Number();
  surface.tolerance_mm = json.At("tolerance_mm").NumberOrNull();
  surface.state = ReadWord<ToleranceState>(json.At("state"));
}

}  // namespace

Json DeviationJson(const Deviation& d) {
  return {{"nominal", Number(d.nominal)},       {"measured", Number(d.measured)},
          {"deviation", Number(d.deviation)},   {"sigma", Number(d.sigma)},
          {"tolerance", Optional(d.tolerance)}, {"state", Word(d.state)}};
}

Deviation ReadDeviation(const JsonReader& json) {
  return {json.At("nominal").Number(),         json.At("measured").Number(),
          json.At("deviation").Number(),       json.At("sigma").Number(),
          json.At("tolerance").NumberOrNull(), ReadWord<ToleranceState>(json.At("state"))};
}

Json InspectionJson(const pipeline::Inspection& in) {
  Json json = {{"verdict", Word(in.verdict)},
               {"probability", Number(in.probability)},
               {"reasons", in.reasons},
               {"direction",
                {{"state", Word(in.direction.state)},
                 {"reversed", in.direction.reversed},
                 {"message", in.direction.message}}},
               {"rows", RowsOfDeviations(in.rows)},
               {"pipe_radius_mm", DeviationJson(in.pipe_radius_mm)},
               {"measured",
                {{"pipe_radius_mm", Number(in.measured.pipe_radius_mm)},
                 {"rows", RowsJson(in.measured.program)},
                 {"position_mm", PointJson(in.measured.X_WT.position_mm)},
                 {"orientation_wxyz", OrientationJson(in.measured.X_WT.orientation)}}},
               {"alignment",
                {{"position_mm", PointJson(in.alignment.X_NW.position_mm)},
                 {"orientation_wxyz", OrientationJson(in.alignment.X_NW.orientation)},
                 {"rms_mm", Number(in.alignment.rms_mm)},
                 {"max_mm", Number(in.alignment.max_mm)}}},
               {"envelope", EnvelopeJson(in)},
               {"surface", SurfaceJson(in.surface)}};
  if (Json features = FeatureInspectionJson(in.features); !features.empty()) {
    json["features"] = std::move(features);
  }
  return json;
}

pipeline::Inspection ReadInspection(const JsonReader& json) {
  pipeline::Inspection in;
  in.verdict = ReadWord<pipeline::Verdict>(json.At("verdict"));
  // Results of before 2026-11-22 say none.
  if (json.Has("probability")) in.probability = json.At("probability").Number();
  in.reasons = json.At("reasons").Texts();
  const JsonReader direction = json.At("direction");
  in.direction.state = ReadWord<pipeline::DirectionState>(direction.At("state"));
  in.direction.reversed = direction.At("reversed").Bool();
  in.direction.message = direction.TextOr("message");

  const JsonReader rows = json.At("rows");
  for (std::size_t i = 0, n = rows.Size(kMaxRows); i < n; ++i) {
    const JsonReader row = rows.Item(i);
    auto& out = in.rows.emplace_back();
    out.length_mm = ReadDeviation(row.At("length_mm"));
    out.rotation_deg = ReadDeviation(row.At("rotation_deg"));
    out.angle_deg = ReadDeviation(row.At("angle_deg"));
    if (row.Has("bend_radius_mm")) out.bend_radius_mm = ReadDeviation(row.At("bend_radius_mm"));
  }
  in.pipe_radius_mm = ReadDeviation(json.At("pipe_radius_mm"));
  const JsonReader measured = json.At("measured");
  in.measured.pipe_radius_mm = measured.At("pipe_radius_mm").Number();
  in.measured.program = ReadRows(measured.At("rows"));
  in.measured.X_WT.position_mm = ReadPoint(measured.At("position_mm"));
  in.measured.X_WT.orientation = ReadOrientation(measured.At("orientation_wxyz"));
  const JsonReader alignment = json.At("alignment");
  in.alignment.X_NW.position_mm = ReadPoint(alignment.At("position_mm"));
  in.alignment.X_NW.orientation = ReadOrientation(alignment.At("orientation_wxyz"));
  in.alignment.rms_mm = alignment.At("rms_mm").Number();
  in.alignment.max_mm = alignment.At("max_mm").Number();
  ReadEnvelope(json.At("envelope"), in);
  ReadSurface(json.At("surface"), in.surface);
  if (json.Has("features")) ReadFeatureInspection(json.At("features"), in.features);
  return in;
}

}  // namespace bendloop::host
