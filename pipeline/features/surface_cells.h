// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "hal/tube.h"
#include "pipeline/fit/wall_cells.h"

namespace bendloop::pipeline {

// Where the unrolled surface, in cells that hold a few samples each, has none though the cells
// around do: worth a close look.
struct EmptyPlace {
  double along_mm = 0, around_deg = 0;  // of its middle (hal/tube_features.h)
  double size_mm = 0;                   // across, with the cells around it
  double narrow_mm = 0;                 // along or around, the lesser, without them
};
// The widest ones first.
std::vector<EmptyPlace> FindEmptyPlaces(const hal::Tube& tube, WallCells cells);

}  // namespace bendloop::pipeline
