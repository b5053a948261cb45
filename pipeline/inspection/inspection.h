// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "hal/bend_program.h"
#include "hal/tube.h"
#include "pipeline/inspection/direction.h"
#include "pipeline/inspection/envelope.h"
#include "pipeline/inspection/feature_inspection.h"
#include "pipeline/inspection/surface_distances.h"
#include "pipeline/tube/alignment.h"
#include "pipeline/tube/measurement.h"
#include "pipeline/tube/tolerance.h"

namespace bendloop::pipeline {

// Half-widths; an empty tolerance is reported and not judged.
struct Tolerances {
  std::optional<double> length_mm = 0.5;
  std::optional<double> rotation_deg = 0.5;
  std::optional<double> angle_deg = 0.5;
  std::optional<double> bend_radius_mm;
  std::optional<double> pipe_radius_mm;
  std::optional<double> envelope_mm = 1.0;  // tangent points and ends from the nominal axis
  std::optional<double> surface_mm = 1.5;   // scanned surface from the nominal surface
  std::optional<double> straightness_mm;    // the height of any straight's bow
  std::optional<double> dent_depth_mm;      // of any dent
};

struct InspectionOptions {
  Tolerances tolerances;
  NominalFeatures features;
  // A deviation within so many sigma of its limit is undecided; 0: each is in or out as measured.
  double decision_sigmas = 2.0;
  // Between bends one of which is smaller than this, the rotation has no meaning and is not judged.
  double least_angle_deg = 2.0;
  DirectionOptions direction;
};

enum class Verdict : std::uint8_t { kPass, kFail, kUndecided };
std::string_view Name(Verdict verdict);  // "pass", "fail", "undecided"

struct RowInspection {
  Deviation length_mm;
  Deviation rotation_deg;                   // not judged in the first and the last row
  Deviation angle_deg;                      // not judged in the last row
  std::optional<Deviation> bend_radius_mm;  // empty in the last row
};

// A measured tube beside its nominal. When direction.settled() is false and the numbers of bends
// agree, everything is filled for the better direction, but must not be used for a correction.
struct Inspection {
  DirectionMatch direction;
  hal::Tube measured;      // rows in the nominal's order, in the world frame
  hal::BendProgram sigma;  // rows in the nominal's order
  Alignment alignment;
  // Empty when the numbers of bends differ.
  std::vector<RowInspection> rows;
  Deviation pipe_radius_mm;
  std::vector<EnvelopePoint> envelope;
  double envelope_max_mm = 0;
  SurfaceDistances surface;
  FeatureInspection features;
  Verdict verdict = Verdict::kUndecided;
  // That every judged number truly is in tolerance, by what the measurement leaves open; the same
  // whatever the rule. 0 where rows could not be compared.
  double probability = 0;
  std::vector<std::string> reasons;  // one sentence for each number that is out or undecided
};

// `nominal_pipe_radius_mm` empty: the measured one is taken for the surface.
Inspection Inspect(const Measurement& measurement, const hal::BendProgram& nominal,
                   std::optional<double> nominal_pipe_radius_mm, const InspectionOptions& options);

}  // namespace bendloop::pipeline
