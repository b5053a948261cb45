// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "hal/spine.h"
#include "hal/tube.h"
#include "pipeline/spine/spine_polygon.h"
#include "pipeline/spline/arc_line_spline.h"
#include "pipeline/structure/structure_score.h"

namespace bendloop::pipeline {

// How the structure search changes a spline: places to start the next fit from.

ArcLineSpline SplineFromTube(const hal::Tube& tube);

// Takes the last bend away if it and the straight beyond it are shorter than `border_mm`: the
// straight before it goes on as far.
bool DropLast(ArcLineSpline& spline, double border_mm);
// The same at the start.
bool DropFirst(ArcLineSpline& spline, double border_mm);
// Without bends that only the border of the samples pretends; false: there were none. Around a cap
// they are as tight as the pipe is thick, which no machine bends.
bool TrimBorders(ArcLineSpline& spline, double pipe_radius_mm);

// Where a tube has less than so many samples a length it is as good as unseen. `segments`: of the
// fit's tube.
double FewSamplesPerMm(const SurfaceFit& fit, std::span<const hal::SpineSegment> segments);
// As many as its segments have in the middle of all.
double UsualSamplesPerMm(const SurfaceFit& fit);

// Without a first or last bend that no samples show: they are missing on the outer straight, and on
// most of the arc, or that is shorter than the border of a scan is sharp (fliers beyond it), or as
// tight as the pipe is thick (a cap). `fit` is of the spline. False: there was none.
bool DropUnseen(ArcLineSpline& spline, const SurfaceFit& fit);

// Without a first or last bend that no tube has: its samples lie so far off it, and off the
// straight beyond it, that it follows what sits on the end, as a nut, a flare or a cap. It
// stays where a tube goes on for long behind it, or where it leads far aside. `fit` is of the
// spline. False: there was none.
bool DropUnexplained(ArcLineSpline& spline, const SurfaceFit& fit);

// The end straights as long as the polygon's ends are away, if that is more. False: neither was
// shorter by `least_mm` or more.
bool ReachEnds(ArcLineSpline& spline, const SpinePolygon& polygon, double least_mm);

// One arc in place of two that follow each other.
std::optional<SplineArc> MergedArc(const SplineArc& a, const SplineArc& b);
// Without arcs [first, last]; with one arc in their place, none if it would be none.
ArcLineSpline WithoutArcs(const ArcLineSpline& spline, std::size_t first, std::size_t last);
std::optional<ArcLineSpline> WithOneArc(const ArcLineSpline& spline, std::size_t first,
                                        std::size_t last);
// Two arcs of half the angle in place of one, with a straight between them that touches the old arc
// in its middle.
std::array<SplineArc, 2> SplitArc(const SplineArc& arc);

// Splines with one bend more.
std::vector<ArcLineSpline> WithBend(const ArcLineSpline& spline, const hal::Tube& tube,
                                    const MissingBend& missing, const SpinePolygon& polygon);

}  // namespace bendloop::pipeline
