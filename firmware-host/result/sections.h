// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "firmware-host/result/json.h"
#include "firmware-host/result/json_reader.h"
#include "firmware-host/result/run_result.h"
#include "firmware-host/result/words.h"
#include "hal/pose.h"

namespace bendloop::host {

// The sections of a result's JSON, each with its reader. See README.md for the keys.

Json PointJson(const Eigen::Vector3d& point_mm);
Eigen::Vector3d ReadPoint(const JsonReader& json);
// [w, x, y, z] with w >= 0, since q and -q are the same rotation.
Json OrientationJson(const Eigen::Quaterniond& orientation);
Eigen::Quaterniond ReadOrientation(const JsonReader& json);

template <class E>
E ReadWord(const JsonReader& json) {
  const std::optional<E> value = FromWord<E>(json.Text());
  if (!value) json.WrongText(Words<E>::kExpected);
  return value.value_or(E{});
}

Json ProgramBlockJson(const hal::ProgramBlock& block);
hal::ProgramBlock ReadProgramBlock(const JsonReader& json);

// The surface's distances stand in the JSON as their statistics only.
Json InspectionJson(const pipeline::Inspection& inspection);
pipeline::Inspection ReadInspection(const JsonReader& json);

// Without the lot's state, which the history keeps.
Json CorrectionJson(const pipeline::Correction& correction);
pipeline::Correction ReadCorrection(const JsonReader& json);

Json InterlocksJson(const pipeline::InterlockReport& report);
pipeline::InterlockReport ReadInterlocks(const JsonReader& json);

Json BenderJson(const CommitReport& report);
CommitReport ReadBender(const JsonReader& json);

// What is left of the tube beside lines, arcs and one section; empty: nothing is known of it.
Json FormJson(const pipeline::Measurement& m);
void ReadForm(const JsonReader& json, pipeline::Measurement& m);

// What is cut into the tube and drilled through its wall; empty: nobody looked.
Json FeaturesJson(const pipeline::Measurement& m);
void ReadFeatures(const JsonReader& json, pipeline::Measurement& m);
Json DeviationJson(const pipeline::Deviation& d);
pipeline::Deviation ReadDeviation(const JsonReader& json);
// Against the nominal's; empty: it has none.
Json FeatureInspectionJson(const pipeline::FeatureInspection& features);
void ReadFeatureInspection(const JsonReader& json, pipeline::FeatureInspection& features);

Json PassesJson(const std::vector<pipeline::PassOffset>& passes);
std::vector<pipeline::PassOffset> ReadPasses(const JsonReader& json);

}  // namespace bendloop::host
