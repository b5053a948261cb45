// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "hal/tube.h"
#include "hal/tube_features.h"
#include "pipeline/fit/bowed_spine.h"
#include "pipeline/fit/surface_points.h"
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

// Where places of the wall lie about its spine.
class PlacesOnWall {
 public:
  explicit PlacesOnWall(const WallSpine& wall);  // which it keeps a reference to

  // The nearest to a place: outwards to it, on the segment's line if that bows; and how far along.
  std::pair<hal::SurfaceFrame, double> FrameTo(const Eigen::Vector3d& place_mm) const;
  SpineFoot FootOf(const Eigen::Vector3d& place_mm) const;
  // Where a place with that foot would be if the straight that it lies on did not bow.
  Eigen::Vector3d Straightened(const Eigen::Vector3d& place_mm, const SpineFoot& foot) const;

 private:
  const WallSpine& wall_;
  std::vector<SegmentFrame> frames_;
  std::vector<std::int32_t> all_;
};

// From end to end of `tube`, whose bends ease; `bowed`: the same as it was fitted, with its bows.
WallSpine WallSpineOf(const BowedTubeState& bowed, const hal::Tube& tube, const Easing& easing);

}  // namespace bendloop::pipeline
