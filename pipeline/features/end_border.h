// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <vector>

#include "pipeline/features/end_sectors.h"
#include "pipeline/features/posterior.h"

namespace bendloop::pipeline {

// A sample about an end: its direction from the axis, and how far it lies beyond the end along it.
struct BandSample {
  double cosine = 1, sine = 0, beyond_mm = 0;
};
// The samples from `below_mm` before a plane to `above_mm` beyond it, all of them; a plane is where
// it meets the axis, and how far it rises towards cosine and sine [mm].
using EndBand = std::function<std::vector<BandSample>(const Eigen::Vector3d& plane_mm,
                                                      double below_mm, double above_mm)>;

// What is known of an end before all samples about its border are looked at.
struct RoughEnd {
  Posterior plane;
  double pipe_radius_mm = 0;
  double smear_mm = 0;      // 1 sigma by which noise is thought to displace a sample
  bool knows_rays = true;   // else noise may displace them as far as this, or hardly at all
  double per_mm2 = 0;       // samples
  double slope_mm = 0;      // 1 sigma of the rise before the scan
  double square_mm = 0;     // the same of an end that is to be square
  bool is_thinned = false;  // from a part of the samples
  EndSectors hidden{};      // samples stop before it there, for another reason
};

// The plane of an end that may be cut as `slope_mm` says, and of one that is to be square.
struct EndBorder {
  Posterior plane, square;
};

// The plane where scattered samples stop, from all that lie about it. Each of them lies before the
// plane but for its noise, and as many as the density behind the border says are missing beyond:
// the likelihood of a Poisson process, which is all that samples tell. How far noise displaces them
// is what was thought, or, where they say otherwise, what they say; both answers count by how
// likely they are. Of a cloud nobody knows which way its noise goes: along rays it hardly moves
// samples along the tube, in all directions as far as across it; either is thought of alike. None:
// they are not scattered (laser lines, a grid), some of the turn is hidden, or, of rays, too few
// lie about the border to tell more than `rough`. `dice`: of four numbers.
std::optional<EndBorder> FitEndBorder(const RoughEnd& rough, const EndBand& band, WalkDice& dice);

}  // namespace bendloop::pipeline
