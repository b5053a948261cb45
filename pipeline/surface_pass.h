// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "pipeline/magnitude_histogram.h"
#include "pipeline/parallel.h"
#include "pipeline/surface_points.h"
#include "pipeline/surface_sums.h"

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

// How many times more the means of patches of the surface scatter than independent noise would have
// it: the ratio of the mean squares between and within patches. Pose errors, ovality and dents move
// neighbours together, and n such samples tell less than n independent ones. Patches and not
// blocks, whose faces, where they lie along the surface, part the points by their noise.
struct DesignEffect {
  double between = 0, within = 0, patches = 0, freedom = 0;

  void Add(const SurfaceAssignment& assignment, std::span<const SegmentFrame> frames,
           double pipe_radius_mm, double limit_mm);
  void Add(const DesignEffect& other);
  double Value() const;  // at least 1
};

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
