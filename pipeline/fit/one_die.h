// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include "pipeline/fit/bends_with_bows.h"

namespace bendloop::pipeline {

// [of their mean] 1 sigma of the radii of one die: as of usual ones (usual_bend_radius.cc).
inline constexpr double kRadiiOfOneDie = 0.015;

// [rad^2] Of a sharp bend: the variance of its curvature along the spine over its radius' square.
double VarianceOfArc(const hal::BendRow& row);

// The tube with all bends, or `only` one, of this radius, its corners where they are. None: its
// bends would not fit between them.
std::optional<hal::Tube> WithBendRadii(const hal::Tube& tube, double bend_radius_mm,
                                       std::optional<std::size_t> only = std::nullopt);

// Of a short bend that eases in and out the samples know the variance of its curvature along the
// spine, arc^2 / 12 and the easing's, and neither by itself. All bends of a tube together tell: of
// one die, and one clamp, those of greater angle have the longer arcs. Where the points are
// explained as well by bends whose radii are alike, and eased alike, `solution` becomes that.
void TryOneDie(std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
               BowedSolution& solution);

}  // namespace bendloop::pipeline
