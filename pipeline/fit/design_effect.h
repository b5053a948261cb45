// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/surface_sums.h"

namespace bendloop::pipeline {

// How many times more the means of patches of the surface scatter than independent noise would have
// it: the ratio of the mean squares between and within patches. Pose errors, ovality and dents move
// neighbours together, and n such samples tell less than n independent ones. Patches and not
// blocks, whose faces, where they lie along the surface, part the points by their noise.
struct DesignEffect {
  double between = 0, within = 0, patches = 0, freedom = 0;
  // Of a side of a straight: sums over its points, for its slope.
  struct Side {
    double n = 0, at_mm = 0, at_mm2 = 0, sum = 0, at_sum = 0;
  };
  std::vector<Side> sides;  // of all segments, in their order

  // `points`: by segment; those further than `limit_mm` from the surface are left out.
  void Add(std::span<const SegmentPoints> points, std::span<const SegmentFrame> frames,
           double pipe_radius_mm, double limit_mm);
  void Add(const DesignEffect& other);
  double Value() const;  // at least 1
  // Of directions: what a side of a straight has in common all along moves the straight, as passes
  // of a scan do that are displaced, and hardly turns it. At least 1, at most Value().
  double OfDirections() const;
  // What sides of straights have in common all along, beyond noise [mm^2]: passes of a scan that do
  // not meet. At least 0.
  double SidesMm2() const;
};

}  // namespace bendloop::pipeline
