// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "hal/tube_features.h"
#include "pipeline/features/opening_surroundings.h"
#include "pipeline/features/wall_patches.h"

namespace bendloop::pipeline {

// Which patches a view sees, in order.
using PatchesSeen = std::vector<std::uint16_t>;

// What views from afar may see of patches about the place of `frame`, each once: all that is
// neither turned away from them nor in the shadow of another part of the tube.
std::vector<PatchesSeen> FindViews(const LookedAtTube& tube, const hal::SurfaceFrame& frame,
                                   std::span<const WallPatch> patches);

}  // namespace bendloop::pipeline
