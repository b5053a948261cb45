// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/result/result_json.h"

#include "firmware-host/result/program_json.h"
#include "firmware-host/result/sections.h"

namespace bendloop::host {
namespace {

Json TubeJson(const hal::Tube& tube) {
  return {{"pipe_radius_mm", Number(tube.pipe_radius_mm)},
          {"rows", RowsJson(tube.program)},
          {"position_mm", PointJson(tube.X_WT.position_mm)},
          {"orientation_wxyz", OrientationJson(tube.X_WT.orientation)}};
}

Json FitJson(const pipeline::Measurement& m) {
  return {{"samples", m.fit.samples},
          {"outliers", m.fit.outliers},
          {"median_abs_distance_mm", Number(m.fit.median_abs_distance_mm)},
          {"rms_distance_mm", Number(m.fit.rms_distance_mm)},
          {"p95_abs_distance_mm", Number(m.fit.p95_abs_distance_mm)},
          {"noise_mm", Number(m.noise_mm)},
          {"coverage", Number(m.coverage)},
          {"longest_gap_mm", Number(m.longest_gap_mm)},
          {"structure_margin", Number(m.structure_margin)},
          {"halves_differ_sigma", Number(m.halves_differ_sigma)}};
}

Json BendShapesJson(const std::vector<pipeline::BendShape>& shapes) {
  Json list = Json::array();
  for (const pipeline::BendShape& shape : shapes) {
    list.push_back({{"ovality_percent", Number(shape.ovality_percent)},
                    {"ovality_sigma_percent", Number(shape.ovality_sigma_percent)},
                    {"outer_wall_mm", Number(shape.outer_wall_mm)},
                    {"outer_wall_sigma_mm", Number(shape.outer_wall_sigma_mm)}});
  }
  return list;
}

Json RowValueJson(const pipeline::RowValue& value) {
  return {{"row", value.row}, {"value", Word(value.kind)}};
}

Json UncertaintyJson(const pipeline::Measurement& m) {
  Json correlations = Json::array();
  for (const pipeline::Correlation& c : m.joint.correlations) {
    correlations.push_back({{"first", RowValueJson(c.first)},
                            {"second", RowValueJson(c.second)},
                            {"coefficient", Number(c.coefficient, 4)}});
  }
  Json known_together = Json::array();
  for (const pipeline::KnownTogether& run : m.joint.known_together) {
    Json values = Json::array();
    for (const pipeline::RowValue& value : run.values) values.push_back(RowValueJson(value));
    known_together.push_back({{"first_bend", run.first_bend},
                              {"last_bend", run.last_bend},
                              {"values", std::move(values)},
                              {"direction_sigma_deg", Number(run.direction_sigma_deg)},
                              {"plane_sigma_deg", Number(run.plane_sigma_deg)},
                              {"length_mm", Number(run.length_mm)},
                              {"length_sigma_mm", Number(run.length_sigma_mm)}});
  }
  const bool is_known = m.joint.is_known;
  return {{"pipe_radius_mm", Number(m.pipe_radius_sigma_mm)},
          {"rows", SigmaRowsJson(m.sigma, m.tube.program)},
          {"correlations", is_known ? std::move(correlations) : Json()},
          {"known_together", is_known ? std::move(known_together) : Json()}};
}

Json SpineJson(const std::vector<pipeline::SpineSample>& spine) {
  Json samples = Json::array();
  for (const auto& sample : spine) {
    samples.push_back({{"position_mm", PointJson(sample.position_mm)},
                       {"pipe_radius_mm", Number(sample.pipe_radius_mm)}});
  }
  return samples;
}

// A stage that ran more than once is one key with the sum; "total" is last.
Json TimingJson(const std::vector<pipeline::StageTime>& timing) {
  Json sums = Json::object();
  double total_ms = 0, given_total_ms = -1;
  for (const auto& [stage, ms] : timing) {
    if (stage == "total") {
      given_total_ms = ms;
      continue;
    }
    total_ms += ms;
    sums[stage] = sums.value(stage, 0.0) + ms;
  }
  for (auto& ms : sums) ms = Number(ms.get<double>(), 3);
  sums["total"] = Number(given_total_ms >= 0 ? given_total_ms : total_ms, 3);
  return sums;
}

}  // namespace

Json ResultJson(const RunResult& result, const ResultJsonOptions& options) {
  const pipeline::Measurement& m = result.measurement;
  Json json = {{"schema", "bendloop.result/1"}};
  if (!result.part.empty()) json["part"] = result.part;
  if (!result.session.empty()) json["session"] = result.session;
  if (!result.time.empty()) json["time"] = result.time;
  if (!result.software.empty()) json["software"] = result.software;
  if (!result.identity.empty()) json["identity"] = result.identity;
  if (!result.repeat_of.empty()) json["repeat_of"] = result.repeat_of;
  json["tube"] = TubeJson(m.tube);
  json["uncertainty_1sigma"] = UncertaintyJson(m);
  json["fit"] = FitJson(m);
  if (!m.passes.empty()) json["fit"]["passes"] = PassesJson(m.passes);
  if (!m.bend_shapes.empty()) json["bend_shapes"] = BendShapesJson(m.bend_shapes);
  if (Json form = FormJson(m); !form.empty()) json["form"] = std::move(form);
  if (Json features = FeaturesJson(m); !features.empty()) json["features"] = std::move(features);
  json["warnings"] = m.warnings;
  if (result.nominal) json["nominal"] = {{"rows", RowsJson(*result.nominal)}};
  if (result.inspection) json["inspection"] = InspectionJson(*result.inspection);
  if (result.commanded) json["commanded"] = ProgramBlockJson(*result.commanded);
  if (result.correction) json["correction"] = CorrectionJson(*result.correction);
  if (result.interlocks) json["interlocks"] = InterlocksJson(*result.interlocks);
  if (result.bender) json["bender"] = BenderJson(*result.bender);
  if (options.spine) json["spine"] = SpineJson(m.spine);
  if (options.timing) json["timing_ms"] = TimingJson(m.timing);
  return json;
}

std::string WriteResultJson(const RunResult& result, const ResultJsonOptions& options) {
  return Dump(ResultJson(result, options), 2) + "\n";
}

}  // namespace bendloop::host
