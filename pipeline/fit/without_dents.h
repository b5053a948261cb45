// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "pipeline/fit/bowed_spine.h"
#include "pipeline/fit/surface_points.h"

namespace bendloop::pipeline {

// The points without those of dents. A dent's middle is an outlier by itself, its slopes are not
// and pull lines and arcs aside. None: there are no dents, or so many that the tube would be lost
// with them. `noise_mm`: 1 sigma of a point.
std::optional<OwnedBlocks> WithoutDents(const BowedTubeState& state, double noise_mm,
                                        std::span<const PointBlock> blocks, double reach_mm);

}  // namespace bendloop::pipeline
