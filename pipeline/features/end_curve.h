// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "pipeline/features/end_evidence.h"
#include "pipeline/features/end_samples.h"
#include "pipeline/features/posterior.h"
#include "pipeline/tube/tube_features.h"

namespace bendloop::pipeline {

// The border of an end that no plane is: ragged, torn, or lasered to fit onto another tube. Its
// place along the tube as a series of how far around it is: x0 + x1 cos + x2 sin + x3 cos 2 + ...,
// in mm, as many terms as the samples pay for (Bayesian information criterion); what each side says
// is their likelihood as it is a plane's. The first three are the plane that is nearest to it all
// round.
//
// None: a plane explains the samples, or lines and columns say too little of some part of the turn.
// `about_mm`: the series that the evidence counts from, of a plane or of such a border, which has
// as many terms then, at least. `hidden`: where samples stop at something that lies above the wall.
std::optional<Posterior> FitEndCurve(const EndEvidence& evidence, const Eigen::VectorXd& about_mm,
                                     const EndSectors& hidden, double pipe_radius_mm);

// How steeply it rises at most, but for its plane [mm of the tube over a radian around it].
double SteepestMm(const Posterior& curve);

// How far it lies beyond its plane, place by place.
std::vector<BorderPlace> PlacesOf(const Posterior& curve);

}  // namespace bendloop::pipeline
