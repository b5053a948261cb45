// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "pipeline/features/end_lines.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/tube_ends.h"
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
// `sigma_mm`: noise of the points, which tells those on the surface.
EndCuts FindEndCuts(double sigma_mm, std::span<const PointBlock> blocks, TubeEnds& ends);

// Where the plane is: beyond_mm = at_mm + pipe radius (cosine cos(around) + sine sin(around)).
struct EndPlane {
  double at_mm = 0, at_sigma_mm = 0;
  double cosine = 0, sine = 0;  // the slope, towards where the tube is longest
  double slope_sigma = 0;       // of either
  double slope_sigmas = 0;      // how many sigma it is from a square cut
  bool of_lines = false;        // told by the laser lines of passes that are known
  bool of_border = false;       // told by all scattered samples beside it (end_border.h)
  bool in_shadow = false;       // on one side samples stop before it (end_shadow.h)
  // Where no plane explains the samples: how far the border lies beyond this one, which is nearest
  // to it all round.
  std::vector<BorderPlace> border;
  int border_terms = 3;  // numbers that it and the plane take
};
// `samples`: from `window_mm` before the end on; `knows_passes`: whether theirs is known. None: too
// few.
std::optional<EndPlane> FitEndPlane(std::span<const EndSample> samples, double pipe_radius_mm,
                                    double window_mm, double sigma_mm, bool knows_passes = true);

}  // namespace bendloop::pipeline
