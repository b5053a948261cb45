// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/fit_priors.h"

#include <Eigen/Dense>
#include <limits>

#include "pipeline/fit/surface_sums.h"

namespace bendloop::pipeline {
namespace {

// What is expected of any tube before it is looked at: 1 sigma. As wide as tubes of one pipe
// differ.
struct ExpectedRanges {
  double length = 10.0;  // [of r_P]
  double angle_rad = 1.0;
  double rotation_rad = 2.0;  // about that of a rotation of which nothing is known, pi / sqrt(3)
  double bend_radius = 3.0;   // [of r_P]
  double start_turn_rad = 1.0;
};
constexpr ExpectedRanges kRange;

}  // namespace

Eigen::VectorXd ExpectedRange(const TubeParameters& parameters, double pipe_radius_mm) {
  const double r = pipe_radius_mm;
  Eigen::VectorXd range = Eigen::VectorXd::Constant(parameters.size(), kRange.length * r);
  for (int i = 2; i < parameters.size() && i < parameters.pipe_radius(); ++i)
    range[i] = kRange.start_turn_rad;
  if (parameters.pipe_radius() >= 0) range[parameters.pipe_radius()] = r;
  for (std::size_t bend = 0; bend < parameters.bends(); ++bend) {
    if (bend > 0) range[parameters.rotation(bend)] = kRange.rotation_rad;
    range[parameters.angle(bend)] = kRange.angle_rad;
    range[parameters.bend_radius(bend)] = kRange.bend_radius * r;
  }
  if (parameters.flattened()) {
    range.tail(parameters.size() - parameters.flattening(0))
        .setConstant(std::numeric_limits<double>::infinity());
  }
  return range;
}

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

double FitPriors::OccamPenalty(const TubeParameters& parameters, const hal::Tube& tube,
                               const Eigen::MatrixXd& matrix, double variance_mm2) const {
  // Of every parameter: 1 sigma of what is expected, and whether `matrix` knows that already.
  Eigen::VectorXd range = ExpectedRange(parameters, tube.pipe_radius_mm);
  Eigen::VectorXd counted = Eigen::VectorXd::Zero(parameters.size());
  for (std::size_t bend = 0; bend_radius && bend < parameters.bends(); ++bend) {
    const int i = parameters.bend_radius(bend);
    const double deviation_mm = *tube.program.rows[bend].bend_radius_mm - bend_radius->mean_mm;
    if (RobustWeight(deviation_mm, bend_radius->sigma_mm) < 0.5) continue;
    range[i] = bend_radius->sigma_mm;
    counted[i] = 1;
  }
  if (parameters.flattened()) {
    const Eigen::Index count = parameters.size() - parameters.flattening(0);
    range.tail(count).setConstant(kUsualFlattening);
    counted.tail(count).setOnes();
  }
  Eigen::MatrixXd ratio = range.asDiagonal() * (matrix / variance_mm2) * range.asDiagonal();
  ratio.diagonal() += Eigen::VectorXd::Ones(parameters.size()) - counted;
  const Eigen::VectorXd pivots = ratio.ldlt().vectorD();
  return pivots.cwiseMax(1.0).array().log().sum();
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
