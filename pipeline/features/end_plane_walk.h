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
// lie is known. `slope_mm`: that the evidence
// counts from.
EndPlane PlaneAmong(EndEvidence evidence, const Eigen::Vector2d& slope_mm, double pipe_radius_mm,
                    WalkDice& dice, const BetterPlane& better = {});

// Whether most of the lines and columns stop where the plane is; else they stop at something that
// is none.
bool Agrees(const EndPlane& plane, const EndEvidence& evidence, const Eigen::Vector2d& slope_mm,
            double pipe_radius_mm);

}  // namespace bendloop::pipeline
