// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <span>
#include <vector>

#include "hal/spine.h"
#include "hal/tube.h"
#include "pipeline/fit/fit_priors.h"
#include "pipeline/fit/surface_sums.h"
#include "pipeline/fit/tube_parameters.h"

namespace bendloop::pipeline {

// The least squares around a tube. The rows of one segment depend on the parameters through the
// segment's local state only, so their sum of outer products says all that is needed of its points.
struct NormalEquations {
  // `sums`: by segment of `spine`.
  NormalEquations(const TubeParameters& parameters, const EasedSpine& spine,
                  std::span<const CondensedSum> sums, const FitPriors& priors, double sigma_mm);

  double Variance() const;  // of a point [mm^2]
  // sigma^2 (J^T J)^-1. What the points do not tell (the radius of a bend that nobody sees) is as
  // vague as before they were looked at; what moves no point at all (a straight's roll) is left
  // out.
  Eigen::MatrixXd Covariance(const TubeParameters& parameters, const hal::Tube& tube,
                             double design_effect) const;

  Eigen::VectorXd at;
  Eigen::MatrixXd matrix, scaled;  // with a diagonal of ones
  Eigen::MatrixXd of_priors;       // what is known without points: the inverse of a covariance
  Eigen::VectorXd right, scale;
  Eigen::VectorXd last_start;  // derivative of where the last straight begins, along it
  double variance_mm2;         // of a point, as what is known without points was weighed by
  double squares_mm2 = 0;      // weighted
  double weight = 0;
};

// The solution stays a tube: no negative straights, no angle of nothing, no bend tighter than the
// pipe. (A bend that begins as a tighter one may stay so: making it wider would move all that comes
// after it away from the points.)
struct FitBounds {
  FitBounds(const TubeParameters& parameters, double pipe_radius_mm, double max_length_mm);

  Eigen::VectorXd Inside(const Eigen::VectorXd& x) const { return x.cwiseMax(low).cwiseMin(high); }
  double Lowest(Eigen::Index i, double at) const { return std::max(low[i], at - step[i]); }
  double Highest(Eigen::Index i, double at) const { return std::min(high[i], at + step[i]); }

  Eigen::VectorXd low, high;
  Eigen::VectorXd step;  // the longest at a time
};

// The damped Gauss-Newton step within bounds: what would leave them goes as far as they are, and
// the others are solved for again. `damping`: of the normal matrix's diagonal.
Eigen::VectorXd BoundedStep(const NormalEquations& equations, const FitBounds& bounds,
                            double damping);

}  // namespace bendloop::pipeline
