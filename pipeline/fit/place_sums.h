// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <vector>

#include "pipeline/fit/bow_shapes.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/surface_sums.h"
#include "pipeline/tube/easing.h"

namespace bendloop::pipeline {

// [rad] from an arc's start, of any angle: what stands at x and y in its frame. Beside the arc the
// nearer of its two ends is meant.
double TurnOf(double x, double y, const hal::SpineSegment& arc);

// [mm] from the segment's start: where point `i`, which stands in the segment's frame, lies along
// it.
double AlongOf(const SegmentPoints& points, Eigen::Index i, const hal::SpineSegment& segment);

// Moves the points of a straight `length_mm` long, which stand in its frame, as if it did not bow.
void Straighten(const Bow& bow, const SegmentFrame& line, double length_mm, double pipe_radius_mm,
                SegmentPoints& points);

// A short piece of a segment, all round, and what its points say of the segment's frame.
struct PlaceSum {
  std::size_t segment = 0;
  double along_mm = 0;  // of its middle, from the segment's start
  CondensedSum sum = CondensedSum::Zero();
};

using LocalMatrix = Eigen::Matrix<double, kLocalState, kLocalState>;
using LocalVector = Eigen::Matrix<double, kLocalState, 1>;

// Of what its points tell of the segment's frame, in the directions that they feel.
struct PlaceInverse {
  LocalMatrix of_felt = LocalMatrix::Zero();
  double rank = 0;
};
PlaceInverse InverseOf(const CondensedSum& sum);

// Of all points near the surface, place after place along the spine, each about `place_mm` long.
// `frames`: of the spine's segments. `sigma_mm` gives the weights. `bows`: of every segment, which
// the points' distances are from; none: straights are straight.
std::vector<PlaceSum> SumPlaces(const EasedSpine& spine, std::span<const SegmentFrame> frames,
                                double pipe_radius_mm, double place_mm,
                                std::span<const PointBlock> blocks, double reach_mm,
                                double sigma_mm, std::span<const Bow> bows = {});

}  // namespace bendloop::pipeline
