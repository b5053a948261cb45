// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "hal/tube_features.h"
#include "pipeline/inspection/opening_shape.h"
#include "pipeline/tube/measurement.h"
#include "pipeline/tube/tolerance.h"

namespace bendloop::pipeline {

// A hole or slot that the part should have, with what may deviate; none: not judged.
struct NominalOpening {
  std::string name;          // "hole 1", "slot 2"
  hal::WallOpening opening;  // along_mm counts from the end that is named
  bool from_end = false;     // from the tube's end, not from its start
  std::optional<double> place_tolerance_mm;
  std::optional<double> around_tolerance_deg;
  std::optional<double> size_tolerance_mm;  // of a hole's diameter any way, of length and width
  std::optional<double> axis_tolerance_deg;
};

struct NominalFeatures {
  std::vector<NominalOpening> openings;
  hal::EndCut first_end, last_end;
  std::optional<double> obliquity_tolerance_deg;  // none: not judged

  bool empty() const { return openings.empty() && !obliquity_tolerance_deg; }
};

enum class OpeningState : std::uint8_t {
  kFound,
  kMissing,  // the scan shows the wall where it should be
  kNotSeen,  // or did not see the place
};
std::string_view Name(OpeningState state);  // "found", "missing", "not seen"

struct OpeningInspection {
  std::string name;
  OpeningKind named = OpeningKind::kHole;  // what the part names
  OpeningState state = OpeningState::kNotSeen;
  std::size_t found = 0;                      // of kFound: which of the measurement's openings
  OpeningKind found_as = OpeningKind::kHole;  // and what the scan shows it to be
  // Of kFound; nominal values otherwise.
  Deviation along_mm;  // from the end that the part names
  Deviation around_deg;
  // As seen along the wall's normal (opening_shape.h). Of a hole that is found where one is named
  // the length is its diameter, and no other is judged.
  Deviation length_mm;
  Deviation width_mm;
  Deviation axis_deg;
  Deviation out_of_round_mm;  // length less width; where round is named, or found
  Deviation lean_deg;         // of the drill's axis; the deviation is the angle between both
};

struct EndInspection {
  bool is_known = false;
  Deviation obliquity_deg;  // the deviation is the angle between both planes
};

struct FeatureInspection {
  std::vector<OpeningInspection> openings;
  EndInspection first_end, last_end;  // in the nominal's order
};

// `measured`: the measurement's tube in the nominal's order, `reversed` if that is not the scan's.
FeatureInspection InspectFeatures(const Measurement& measurement, const NominalFeatures& nominal,
                                  const hal::Tube& measured, bool reversed, double decision_sigmas);

}  // namespace bendloop::pipeline
