// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "pipeline/fit/design_effect.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/surface_sums.h"
#include "pipeline/math/magnitude_histogram.h"
#include "pipeline/math/workers.h"

namespace bendloop::pipeline {

// Points given to the segments of a tube whose spines are nearest. Distances, and the reach, count
// in units of a point's own certainty: each is the distance times it. Its memory is used again.
struct SurfaceAssignment {
  std::vector<SegmentPoints> segments;  // within reach of the surface, in the segment's frame
  std::vector<double> distances_mm;     // the same points' signed distances, as they came
  std::size_t total = 0;                // points looked at
  std::vector<double> segment_count;    // all points near a segment
  std::vector<double> segment_sum_mm2;  // of min(d, reach)^2 over these
};

// Looks at every point once. `frames`: of the tube's segments.
void AssignPoints(std::span<const SegmentFrame> frames, double pipe_radius_mm,
                  std::span<const PointBlock> blocks, double reach_mm, SurfaceAssignment& result);

// What least squares needs of all points near a tube's surface.
struct SurfacePass {
  std::vector<CondensedSum> sums;  // by segment
  MagnitudeHistogram magnitudes;   // of the distances within reach
  DesignEffect design_effect;
  std::size_t total = 0;
  std::vector<double> segment_count, segment_sum_mm2;

  void Add(const SurfacePass& other);
};

// One walk over any number of points, in constant memory; `sigma_mm` gives the weights. The result
// does not depend on the workers.
SurfacePass PassOverSurface(std::span<const SegmentFrame> frames, double pipe_radius_mm,
                            std::span<const PointBlock> blocks, double reach_mm, double sigma_mm,
                            Workers* workers = nullptr);

}  // namespace bendloop::pipeline
