// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "hal/bend_program.h"
#include "pipeline/tube/joint_uncertainty.h"

namespace bendloop::pipeline {

// Covariance of a measured tube's values (TubeValues, mm and degrees) from the sigmas of its rows
// and the correlations that the fit found worth saying; both in the order of the rows. Correlations
// of bend radii, which no bender is told, are left out. Always one that can be: where the strong
// correlations contradict each other for want of the weak ones, they are made smaller.
Eigen::MatrixXd MeasuredCovariance(const hal::BendProgram& sigma,
                                   const std::vector<Correlation>& correlations);

// The correlations of a tube of so many bends, counted from its other end.
std::vector<Correlation> ReversedCorrelations(std::vector<Correlation> correlations,
                                              std::size_t bends);

}  // namespace bendloop::pipeline
