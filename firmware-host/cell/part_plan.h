// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "config/cell_config.h"
#include "firmware-host/commit/commit_protocol.h"
#include "hal/bend_program.h"
#include "hal/result.h"
#include "pipeline/correction/correction.h"
#include "pipeline/correction/interlocks.h"
#include "pipeline/inspection/inspection.h"
#include "pipeline/reconstruction.h"

namespace bendloop::host {

// For the final fit of a scan, beside one sample a voxel: 1 sigma of an angle is then about a
// thousandth of a degree, well below what any scanner is true to, and the answer is ready in time.
inline constexpr std::size_t kMostPoints = 50'000;
// Of the laser lines of a scan that has more, for its ends, holes and slots: borders are as sharp
// as its rays lie close, and most of them are looked at only there. Eight bytes each.
inline constexpr std::size_t kMostLinePoints = 1'000'000;

// What the cell file means for the pipeline: everything that a run of one part goes by.
struct PartPlan {
  std::string part;
  std::uint32_t part_number = 0;
  hal::BendProgram nominal;
  double pipe_radius_mm = 0;
  double nominal_length_mm = 0;  // of the whole spine
  bool corrects = true;          // false: measure and judge only
  unsigned tubes_between = 0;    // that wait between bender and scanner
  pipeline::ReconstructionOptions reconstruction;
  pipeline::InspectionOptions inspection;
  pipeline::CorrectionOptions correction;
  pipeline::InterlockOptions interlocks;
  CommitOptions commit;
  std::string config_digest;
};

// kBadInput when the part's nominal is no tube, or its material none that bends.
hal::Result<PartPlan> MakePartPlan(const config::CellConfig& cell);

// The nominal as rows, whichever way the part file gives it.
hal::Result<hal::BendProgram> NominalProgram(const config::PartConfig& part);
pipeline::Material MaterialOf(const config::PartConfig& part);
// Holes, slots and ends as the part file gives them.
pipeline::NominalFeatures FeaturesOf(const config::PartConfig& part);
// The same as they are cut into a tube with a spine of this length.
hal::TubeFeatures CutsOf(const config::PartConfig& part, double length_mm);

}  // namespace bendloop::host
