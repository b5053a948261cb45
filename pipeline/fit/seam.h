// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "pipeline/fit/bowed_spine.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// The weld seam of a tube: a narrow ridge all along it. A bender turns the tube and does not twist
// it, so that the seam stays at one angle of a frame that is carried along the spine without twist.
// None: there is none, or the samples do not show it on most of the tube. `fit`: its design effect
// and the points that have no say in it tell at once of most tubes that there is none.
std::optional<SeamFound> FindSeam(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                                  double reach_mm);

// The same on the tube that was fitted beside it, and by many more points: what the seam pulled
// aside, as the normals that its place counts from, is where it is. `state`: that tube as its
// straights bow; `tube`: it with best-fit lines.
SeamFound MeasureSeam(const SeamFound& found, const BowedTubeState& state, const hal::Tube& tube,
                      double noise_mm, std::span<const PointBlock> blocks, double reach_mm);

// The points that do not lie on the seam, which pulls the spine to its side.
OwnedBlocks WithoutSeam(const SurfaceFit& fit, const SeamFound& seam,
                        std::span<const PointBlock> blocks);

}  // namespace bendloop::pipeline
