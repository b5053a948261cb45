// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "pipeline/fit/bowed_spine.h"
#include "pipeline/fit/surface_points.h"

namespace bendloop::pipeline {

// The points `from` without those of dents, which all points, `blocks`, show. A dent's middle is an
// outlier by itself, its slopes are not and pull lines and arcs aside. None: there are no dents, or
// so many that the tube would be lost with them. `noise_mm`: 1 sigma of a point. Where `from` are
// fewer, only dents between the end straights count: what sits on an end looks like dents there,
// others each time. `wide`: so many times as wide a circle is left out as a dent takes.
std::optional<OwnedBlocks> WithoutDents(const BowedTubeState& state, double noise_mm,
                                        std::span<const PointBlock> blocks,
                                        std::span<const PointBlock> from, double reach_mm,
                                        double wide = 1.0);

}  // namespace bendloop::pipeline
