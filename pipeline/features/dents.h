// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "hal/tube.h"
#include "pipeline/features/cut_faces.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/tube_ends.h"
#include "pipeline/fit/wall_spine.h"
#include "pipeline/tube/flattening.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// What the dents lie in.
struct WallForm {
  const WallSpine& about;
  std::span<const Flattening> flattening;  // of every bend, or none
};

// Place, depth and area of dents that were seen in cells of the surface (fit/surface_form.h), from
// the points themselves (dent_fit.h). What cannot be fitted stays as the cells have it, its depth
// known to about itself or worse, where its points show one; else it goes. Those that cells hardly
// show (kClearDents) are told only where they are fitted, and for certain.
// The deepest first, each once: cells may have parted one, or taken what is beside it or opposite
// it for pressed in.
//
// `faces`: where the wall was cut; what is seen of them is no wall.
// `noise_mm`: 1 sigma of a point along the normal.
// Places are those of `tube`, whose bends are sharp and round.
void MeasureDents(const hal::Tube& tube, const WallForm& wall, const TubeEnds& ends,
                  const CutFaces& faces, double noise_mm, std::span<const PointBlock> blocks,
                  std::vector<DentFound>& dents);

}  // namespace bendloop::pipeline
