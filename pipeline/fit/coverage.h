// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "hal/tube.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/wall_cells.h"
#include "pipeline/fit/wall_spine.h"
#include "pipeline/math/workers.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// Fills what the samples say of a fitted tube: distances (fit), surface, spine with local radius,
// coverage and longest gap. `wall`: what its wall lies about (WallSpineOf()). `sigma_mm`: noise,
// beyond 5 of which a sample is an outlier.
// `all_samples`: also those that no block holds because they are far from the tube. Returns where
// on the tube of sharp bends the samples are: the same walk knows.
WallCells DescribeSamples(std::span<const PointBlock> blocks, std::size_t all_samples,
                          const WallSpine& wall, double sigma_mm, Measurement& measurement,
                          Workers* workers = nullptr);

}  // namespace bendloop::pipeline
