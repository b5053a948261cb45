// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "hal/tube.h"
#include "pipeline/fit/bowed_spine.h"
#include "pipeline/tube/easing.h"

namespace bendloop::pipeline {

// What the wall of a tube lies about. Where its straights bow, their best-fit lines pass each
// other, and the tube of their corners lies beside its samples by more than the bows are high: by a
// millimetre where a bend turns far.
struct WallSpine {
  EasedSpine spine;  // bends where the samples are, and between them the straights' best-fit lines
  std::vector<Bow> bows = {};  // about these lines, by segment; none: nothing bows

  // How far it lies beside the segment's line there.
  Eigen::Vector3d BesideMm(std::size_t segment, double along_mm) const;
};

// From end to end of `tube`, whose bends ease; `bowed`: the same as it was fitted, with its bows.
WallSpine WallSpineOf(const BowedTubeState& bowed, const hal::Tube& tube, const Easing& easing);

}  // namespace bendloop::pipeline
