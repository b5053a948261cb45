// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "pipeline/tube_parameters.h"

namespace bendloop::pipeline {

// Bends come from one die, as a rule. One that is not as the others costs no more than an outlier.
struct UsualBendRadius {
  double mean_mm = 0;
  double sigma_mm = 0;
};

// What is known of a tube before its points are looked at. In a fit each item counts like one more
// point, with the same weights that fade out.
struct FitPriors {
  std::optional<UsualBendRadius> bend_radius;

  // Adds them to the normal equations, whose points have the noise `sigma_mm`.
  void Add(const TubeParameters& parameters, const Eigen::VectorXd& at, double sigma_mm,
           Eigen::MatrixXd& matrix, Eigen::VectorXd& right) const;
  // What they cost at a tube, in variances.
  double ChiSquare(const hal::BendProgram& program, std::span<const Flattening> flattening) const;
};

}  // namespace bendloop::pipeline
