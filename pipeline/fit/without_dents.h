// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "pipeline/fit/bowed_spine.h"
#include "pipeline/fit/dent_margin.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// The points `from` without those of dents, which all points, `blocks`, show. A dent's middle is an
// outlier by itself, its slopes are not and pull lines and arcs aside. None: there are no dents, or
// so many that the tube would be lost with them. `noise_mm`: 1 sigma of a point. Where `from` are
// fewer, only dents between the end straights count: what sits on an end looks like dents there,
// others each time.
std::optional<OwnedBlocks> WithoutDents(const BowedTubeState& state, double noise_mm,
                                        std::span<const PointBlock> blocks,
                                        std::span<const PointBlock> from, double reach_mm,
                                        const DentMargin& margin = {});

// Places where a bend may have taken a dent in, the deepest first: less than dents clearly are, or
// as much, if none is left out. `from`: the points that no dent has been left out of.
std::vector<DentFound> FaintDents(const BowedTubeState& state, double noise_mm,
                                  std::span<const PointBlock> blocks,
                                  std::span<const PointBlock> from, double reach_mm);

// Those `from` without as much as a dent can take about that place.
OwnedBlocks WithoutDentAt(const BowedTubeState& state, const DentFound& dent,
                          std::span<const PointBlock> from);

}  // namespace bendloop::pipeline
