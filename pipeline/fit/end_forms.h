// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <span>

#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/tube_ends.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// An end of the plain tube, as FindTubeEnds() has it.
struct PlainEnd {
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d outward = Eigen::Vector3d::UnitX();  // along the straight, out of the tube
  // Of that straight: further in the tube bends away.
  double straight_mm = std::numeric_limits<double>::infinity();
};

struct FoundEnd {
  EndForm form;
  double sigma_mm = 0;  // 1 sigma of where all ends; of use if the form has a length
};

// What sits on the end: a nut, a flange, a flare, a bead, a cap, which stand out all round it. And
// whether samples go on beyond it, too thin for a tube to be followed, be it straight or not.
// `near`: points about the end; `others`: those that no part of the tube was found near.
// `usual_per_mm`: points of the whole tube by its length; where an end has far fewer, what goes on
// may bend away from it.
FoundEnd FindEndForm(const PlainEnd& end, double pipe_radius_mm, double noise_mm,
                     std::span<const PointBlock> near, std::span<const PointBlock> others,
                     double usual_per_mm);

// What sits on the end alone.
FoundEnd FindFitting(const PlainEnd& end, double pipe_radius_mm, double noise_mm,
                     std::span<const PointBlock> near);

// How far from the end `near` is asked for, in pipe radii.
constexpr double kEndFormReach = 8.0;

}  // namespace bendloop::pipeline
