// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "hal/result.h"
#include "pipeline/features/border_fit.h"

namespace bendloop::pipeline {

struct CurveFitOptions {
  // 0: as many as the noise supports (Bayesian information criterion).
  int pieces = 0;
  int most_pieces = 40;
  // Corners that the border does not name are looked for (border_corners.h).
  bool find_corners = true;
  // Neighbouring points that are off together, as points are that were smoothed: so many of them
  // tell as much as one.
  double points_of_independent = 1;
  // Further points are left out, evenly.
  std::size_t most_points = 6000;
};

// Least squares of the distances of a border's points from a curve, all of joints, tangents,
// handles, weights and the points' parameters at once: the global optimum that the paper compares
// with (equations 3.5 and 3.14), with joints and tangents free as well. G1 in every joint that is
// no corner. kBadInput: fewer than 6 points, points that are no numbers, or all in one place. The
// result holds a foot for each of the border's points, whichever were fitted.
hal::Result<BorderFit> FitBorder(const OrderedBorder& border, const CurveFitOptions& options = {});

// The same from a given curve, its number of pieces kept.
hal::Result<BorderFit> FitBorderFrom(const OrderedBorder& border, const RationalBezier& start);

// 1 sigma of the curve across itself at a place of it, in one direction, if each point is off by
// `noise_mm`: the covariance of all unknowns, parameters of points left free.
struct CurveSigma {
  double mean_mm = 0;  // root mean square along the curve
  double most_mm = 0;
};
CurveSigma SigmaOfCurve(const RationalBezier& curve, const std::vector<CurveFoot>& feet,
                        double noise_mm);

}  // namespace bendloop::pipeline
