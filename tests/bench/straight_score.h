// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "hal/tube.h"
#include "tests/bench/comparison.h"
#include "tests/bench/rivals.h"

namespace bendloop::bench {

// How cylinders, from whomever, fit a tube's straights.
struct StraightScore {
  std::size_t straights = 0;
  std::size_t found = 0;
  Ratio radius_mm;  // errors, rms over the straights that were found
  Ratio angle_deg;  // of the angles between neighbours that were both found
};

// A straight is found when a cylinder's axis runs along it within 5 degrees and passes its middle
// within half a pipe radius; of several that with most points counts.
StraightScore ScoreStraights(const hal::Tube& truth, std::span<const FoundCylinder> cylinders);

// A measured tube's own straights, to be scored alike.
std::vector<FoundCylinder> StraightsOf(const hal::Tube& tube);

}  // namespace bendloop::bench
