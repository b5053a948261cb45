// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>

#include "pipeline/features/end_evidence.h"
#include "pipeline/features/end_plane.h"
#include "pipeline/features/posterior.h"

namespace bendloop::pipeline {

// Of what is roughly known of a plane, what more is known; none: nothing.
using BetterPlane = std::function<std::optional<Posterior>(const Posterior&)>;

// Mean and spread of all planes that lines and columns allow; `better`: asked when where about they
// lie is known. `slope_mm`: that the evidence counts from; `usual_slope`: before the scan, 1 sigma.
EndPlane PlaneAmong(EndEvidence evidence, const Eigen::Vector2d& slope_mm, double pipe_radius_mm,
                    WalkDice& dice, const BetterPlane& better = {},
                    double usual_slope = kEndPlane.usual_slope);

// By how much lines and columns stop elsewhere than where a plane is: those are of a border that is
// none, or of something else.
struct PlaneMisfit {
  bool is_none = true;  // but of a few
  double part = 0;      // of all sides and columns near the plane, those that contradict it
  double rms_mm = 0;    // of these sides
};
PlaneMisfit MisfitOf(const EndPlane& plane, const EndEvidence& evidence,
                     const Eigen::Vector2d& slope_mm, double pipe_radius_mm);

}  // namespace bendloop::pipeline
