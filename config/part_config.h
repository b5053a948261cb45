// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "hal/bend_program.h"
#include "hal/tube_features.h"

namespace bendloop::config {

// What the drawing allows; each is a plus-minus about the nominal.
struct Tolerances {
  double length_mm = 0.5;
  double rotation_deg = 0.5;
  double angle_deg = 0.5;
  double envelope_mm = 1.0;               // tangent points, after best-fit alignment
  double surface_mm = 1.0;                // whole surface, after best-fit alignment
  std::optional<double> straightness_mm;  // height of any straight's bow; none: not judged
  std::optional<double> dent_depth_mm;    // of any dent; none: not judged
};

// How the material answers to bending, as the trade enters it. Springback is linear in the bend
// angle, through the two given points; positive: the tube opens after the bend.
struct Material {
  double springback_at_20_deg = 0;
  double springback_at_120_deg = 0;
  double elongation_percent = 0;  // (measured length - cut length) / sum of the arc lengths
};

// A [[hole]] or [[slot]]; a hole's length and width are its diameter.
struct OpeningConfig {
  std::optional<double> from_start_mm;  // along the spine, to its middle; one of these two
  std::optional<double> from_end_mm;
  double around_deg = 0;  // hal/tube_features.h says from where
  double length_mm = 0;
  double width_mm = 0;
  double axis_deg = 0;
  double lean_along_deg = 0, lean_around_deg = 0;  // of a hole's axis, as hal/tube_features.h
  double place_tolerance_mm = 0.5;
  double around_tolerance_deg = 2;
  double size_tolerance_mm = 0.3;
  double axis_tolerance_deg = 2;
};

// [end]: how the ends are cut.
struct EndsConfig {
  hal::EndCut first, last;
  std::optional<double> obliquity_tolerance_deg;  // none: not judged
};

// One part number: its nominal, what may deviate, what it is made of. The defaults here are the
// defaults of the part file, schema "bendloop.part/1" (README.md).
struct PartConfig {
  std::string name;
  std::uint32_t part_number = 0;
  double pipe_radius_mm = 0;  // outer
  std::optional<double> wall_mm;
  // Exactly one of these two holds the nominal.
  hal::BendProgram rows;                 // from [[row]]; every bend has its bend radius
  std::vector<Eigen::Vector3d> xyz_mm;   // from [nominal]: control polygon, both ends included
  std::optional<double> bend_radius_mm;  // CLR of every bend without its own; given with xyz_mm
  std::vector<OpeningConfig> holes, slots;
  EndsConfig ends;
  Tolerances tolerance;
  Material material;

  std::filesystem::path file;  // where it came from; empty: from text
};

}  // namespace bendloop::config
