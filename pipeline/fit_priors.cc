// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit_priors.h"

#include "pipeline/surface_sums.h"

namespace bendloop::pipeline {

void FitPriors::Add(const TubeParameters& parameters, const Eigen::VectorXd& at, double sigma_mm,
                    Eigen::MatrixXd& matrix, Eigen::VectorXd& right) const {
  const auto add = [&](Eigen::Index i, double deviation, double usual, double weight) {
    const double certainty = weight * sigma_mm * sigma_mm / (usual * usual);
    matrix(i, i) += certainty;
    right[i] -= certainty * deviation;
  };
  if (parameters.flattened()) {
    for (Eigen::Index i = parameters.flattening(0); i < parameters.size(); ++i) {
      add(i, at[i], kUsualFlattening, 1.0);
    }
  }
  if (!bend_radius) return;
  for (std::size_t bend = 0; bend < parameters.bends(); ++bend) {
    const Eigen::Index i = parameters.bend_radius(bend);
    const double deviation_mm = at[i] - bend_radius->mean_mm;
    add(i, deviation_mm, bend_radius->sigma_mm, RobustWeight(deviation_mm, bend_radius->sigma_mm));
  }
}

double FitPriors::ChiSquare(const hal::BendProgram& program,
                            std::span<const Flattening> flattening) const {
  double sum = 0;
  for (const Flattening& f : flattening) {
    sum += (f.constant * f.constant + f.bump * f.bump + f.collapse * f.collapse) /
           (kUsualFlattening * kUsualFlattening);
  }
  for (std::size_t bend = 0; bend_radius && bend < program.bend_count(); ++bend) {
    const double radius_mm = program.rows[bend].bend_radius_mm.value_or(bend_radius->mean_mm);
    sum += RobustSum(radius_mm - bend_radius->mean_mm, bend_radius->sigma_mm);
  }
  return sum;
}

}  // namespace bendloop::pipeline
