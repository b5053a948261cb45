// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/tube_ends.h"
#include "pipeline/tube/tube_features.h"

namespace bendloop::pipeline {

struct EndCuts {
  // None: too few samples lie on that end, or on too little of its turn, to tell a plane.
  std::optional<EndCutFound> first, last;
};

// The planes that the ends are cut by. Where one is certainly oblique (5 sigma) `ends` is set to
// where it meets the spine; the borders' outermost point, which a square end's is, lies up to a
// pipe radius times the slope further out. A square end stays as it was found.
//
// In each of many narrow columns along the tube the samples stop somewhere before the plane. How
// far before, tell the gaps between the samples of the column: laser lines may leave one whole gap,
// scattered points any, each longer one more rarely. So each column has a likelihood of where the
// plane is, and the mean over all planes (posterior.h) is the estimate.
// `sigma_mm`: noise of the points, which tells those on the surface.
EndCuts FindEndCuts(double sigma_mm, std::span<const PointBlock> blocks, TubeEnds& ends);

// A sample near an end: around the feed direction from AroundZero() [radians], and beyond the end
// along it [mm], negative on the tube.
struct EndSample {
  double around_rad = 0;
  double beyond_mm = 0;
};
// Where the plane is: beyond_mm = at_mm + pipe radius (cosine cos(around) + sine sin(around)).
struct EndPlane {
  double at_mm = 0, at_sigma_mm = 0;
  double cosine = 0, sine = 0;  // the slope, towards where the tube is longest
  double slope_sigma = 0;       // of either
  double slope_sigmas = 0;      // how many sigma it is from a square cut
};
// `samples`: from `window_mm` before the end on. None: too few.
std::optional<EndPlane> FitEndPlane(std::span<const EndSample> samples, double pipe_radius_mm,
                                    double window_mm, double sigma_mm);

}  // namespace bendloop::pipeline
