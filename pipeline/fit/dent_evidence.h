// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "pipeline/fit/bends_with_bows.h"
#include "pipeline/fit/surface_points.h"

namespace bendloop::pipeline {

struct DentEvidenceSettings {
  // [variances] By which points beside dents may be explained worse.
  double worse = 6.0;
  // Of a dent: two of its place, its depth and two of its size.
  double numbers = 5.0;
};
inline constexpr DentEvidenceSettings kDentEvidence;

// What patches of the surface are off the tube in `all` points that the `others` have not, beyond
// what noise moves them by [variances].
double OfDents(const BowedSolution& plain, std::span<const PointBlock> all,
               std::span<const PointBlock> others, double reach_mm);

// How much better all points speak for `dented`, a tube that leaves some more of them to dents
// [twice the logarithm of the odds]. Below 0 where the others do not like it, and where there are
// no more.
double EvidenceOfDents(const BowedSolution& dented, const BowedSolution& plain,
                       std::span<const PointBlock> blocks, double reach_mm);

}  // namespace bendloop::pipeline
