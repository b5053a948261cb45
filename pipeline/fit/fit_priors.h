// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "pipeline/fit/tube_parameters.h"

namespace bendloop::pipeline {

// Bends come from one die, as a rule. One that is not as the others costs no more than an outlier.
struct UsualBendRadius {
  double mean_mm = 0;
  double sigma_mm = 0;
};

// What one expects of any tube: 1 sigma of every parameter (mm, rad); infinite for flattening and
// easing, which have priors of their own.
Eigen::VectorXd ExpectedRange(const TubeParameters& parameters, double pipe_radius_mm);

// What is known of a tube before its points are looked at. In a fit each item counts like one more
// point, with the same weights that fade out.
struct FitPriors {
  std::optional<UsualBendRadius> bend_radius;
  // [of their mean] 1 sigma of the bend radii, whatever that is; 0: nothing is known.
  double radii_alike = 0;
  // Bends of another die: nothing is expected of their radii.
  std::vector<std::size_t> odd_bends = {};
  bool IsOdd(std::size_t bend) const {
    return std::find(odd_bends.begin(), odd_bends.end(), bend) != odd_bends.end();
  }
  // [of r_P] 1 sigma of how far outer walls sink in, beyond ovals.
  double sunk = kUsualFlattening;
  Eigen::Vector4d FlatteningRange() const;  // 1 sigma, as Flattening has its numbers
  // Of the bends that are not odd; none: there are none.
  std::optional<double> MeanRadiusMm(const hal::BendProgram& program) const;
  // [of their mean] 1 sigma of the easings' variances: clamp and dies are the same for all bends of
  // a tube. By trial; a tenth of the easing length.
  double easings_alike = 0.2;

  // Adds them to the normal equations, whose points have the noise `sigma_mm`.
  void Add(const TubeParameters& parameters, const Eigen::VectorXd& at, double sigma_mm,
           Eigen::MatrixXd& matrix, Eigen::VectorXd& right) const;
  // What they cost at a tube, in variances.
  double ChiSquare(const hal::BendProgram& program, std::span<const Flattening> flattening,
                   const Easing& easing = {}) const;

  // How much more the points know than was expected of any tube before: twice the logarithm of the
  // ratio of the two volumes of parameters. `matrix`: of least squares, with Add(); `variance_mm2`
  // of a point. It is what parameters cost where structures are compared: the log evidence is the
  // log likelihood and the logarithm of the Occam factor (MacKay, Bayesian interpolation, 1992), of
  // which this is -2 times.
  double OccamPenalty(const TubeParameters& parameters, const hal::Tube& tube,
                      const Eigen::MatrixXd& matrix, double variance_mm2) const;
};

}  // namespace bendloop::pipeline
