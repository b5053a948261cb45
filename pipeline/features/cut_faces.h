// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "hal/tube.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/tube/measurement.h"
#include "pipeline/tube/tube_features.h"

namespace bendloop::pipeline {

// Where a tube's wall was cut: the planes of its ends and what was drilled through. Right at the
// border lie the faces that the cuts left of the wall: below the surface, and no part of it.
class CutFaces {
 public:
  CutFaces(const hal::Tube& tube, const TubeFeaturesFound& features);

  // Whether a point lies no further than `reach_mm` from what was cut away, or in it.
  bool AreAt(const Eigen::Vector3d& point_mm, double reach_mm) const;
  // So far from what was cut away samples of its faces are. `noise_mm`: 1 sigma of a point.
  static double ReachMm(double noise_mm, double pipe_radius_mm);

 private:
  struct End {
    Eigen::Vector3d point_mm, normal;  // out of the tube; of unit length
    double near_mm;                    // no further away is anything of it
  };
  struct Opening {
    Eigen::Vector3d middle_mm, outward, drill, along;
    double half_line_mm = 0, half_width_mm = 0, pipe_radius_mm = 0;
  };
  std::vector<End> ends_;
  std::vector<Opening> openings_;
};

// Takes out of `dents` what is none: a wall that was pressed in goes down to its depth on all its
// sides, and what is seen of the faces of cuts, or of the bore through an end or an opening, lies
// below the surface at once. `noise_mm`: 1 sigma of a point.
void KeepPressedIn(const hal::Tube& tube, const CutFaces& faces, double noise_mm,
                   std::span<const PointBlock> blocks, std::vector<DentFound>& dents);

}  // namespace bendloop::pipeline
