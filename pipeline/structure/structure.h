// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "hal/bend_program.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/spine/spine_polygon.h"

namespace bendloop::pipeline {

struct StructureOptions {
  // Times the usual evidence is asked for a bend, where samples err together.
  double caution = 1;
  // What the tube should be. It decides where the samples do not.
  std::optional<hal::BendProgram> nominal = std::nullopt;
};

// How many bends, and about where: the shortcut graph at several tolerances, each solution fitted
// to the samples, and of these the one that explains them with the fewest parameters (Bayesian
// information criterion); then bends are added where the samples ask for them, neighbours are
// merged and bends of nearly nothing dropped, as long as the samples do not mind. Then once more
// with the radius that most bends share, and with bends that need not be round, where either
// explains the samples better; and if what was found cannot be the nominal, the nominal is tried.
// The tangent lines of the graph are fixed to a noisy polygon, which alone gets 28 of 30 tubes
// right (Bauer & Polthier 2009, sections 4.1, 8 and 9); the comparison on the surface is the cure.
// `samples`: near the polygon, evenly spread; `all_points`: these and what else is known there, for
// the last word.
SurfaceFit FindStructure(const SpinePolygon& polygon, double pipe_radius_mm,
                         std::span<const PointBlock> samples,
                         std::span<const PointBlock> all_points,
                         const StructureOptions& options = {});

// The quick first answer of it, for the live view of a scan that still runs.
SurfaceFit GlanceAtStructure(const SpinePolygon& polygon, double pipe_radius_mm,
                             std::span<const PointBlock> samples);

}  // namespace bendloop::pipeline
