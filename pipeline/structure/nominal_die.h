// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "hal/bend_program.h"
#include "pipeline/fit/bends_with_bows.h"

namespace bendloop::pipeline {

// Radii that are the nominal's as the nominal has them: the samples leave sharp bends of another
// die as likely.
struct OtherDie {
  double nominal_mm = 0, sharp_mm = 0, sharp_sigma_mm = 0;
};

// One bend that eases, or few that turn alike, look like sharp ones of a wider radius: the samples
// know the variance of its curvature along the spine and not what is arc and what is easing. The
// nominal knows the die. Where found radii are wider than its own, the tube is fitted with bends of
// these that ease; of the two it is what points and nominal together make likelier, and as
// uncertain as the other is likely. Now and then another die is mounted than the nominal's.
// None: samples tell, or radii are hardly another's. `doubts` gets what the tube may be as well.
std::optional<OtherDie> TryNominalDie(const hal::BendProgram& nominal,
                                      std::span<const PointBlock> blocks,
                                      const SurfaceFitOptions& options, std::vector<Doubt>& doubts,
                                      BowedSolution& solution);

}  // namespace bendloop::pipeline
