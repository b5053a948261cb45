// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/tube_ends.h"
#include "pipeline/points/kept_lines.h"
#include "pipeline/tube/tube_features.h"

namespace bendloop::pipeline {

struct EndCuts {
  // None: too few samples lie on that end, or on too little of its turn, to tell a plane.
  std::optional<EndCutFound> first, last;
};

// The planes that the ends are cut by, with what they have beside them: a bevel, a burr, and a
// border that no plane is (end_bevel.h, end_burr.h, end_curve.h). Where there is a bevel the tube
// ends at its tip. Where one is certainly oblique (5 sigma), or laser lines tell its place better
// than the borders' outermost point does, `ends` is set to where it meets the spine. Other square
// ends stay as they were found: of an oblique one that point lies up to a pipe radius times the
// slope further out.
//
// Of laser lines whose pass is known each narrow strip along the tube says that the plane lies
// beyond its last line and before the next. Lines that an oblique cut ends halfway say so to the
// distance of rays. Other samples stop somewhere before the plane in each narrow column: how far
// before, tell the gaps between them, each longer one more rarely. So every strip or column has a
// likelihood of where the plane is, and the mean over all planes (posterior.h) is the estimate.
// `sigma_mm`: noise of the points, which tells those on the surface. `blocks`: hold the points in
// the balls about the ends, at least.
EndCuts FindEndCuts(double sigma_mm, std::span<const PointBlock> blocks, TubeEnds& ends);
// What ends are looked at with.
std::vector<Ball> BallsAbout(const TubeEnds& ends);

}  // namespace bendloop::pipeline
