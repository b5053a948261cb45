// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/normal_equations.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "pipeline/math/dense_solve.h"

namespace bendloop::pipeline {
namespace {

struct BoundSettings {
  // [rad] A slight bend may turn over to the other side; as far as one is slight
  // (tube_parameters.cc).
  double turn_back_rad = 0.5;
  // [rad] The longest step of an angle: where samples hardly feel it, linear means nothing.
  double step_rad = 1.0;
  // [of r_P] Of a bend's radius: the greatest, and the least of bends that begin tighter than the
  // pipe. By trial.
  double widest_bend = 100.0, tightest_bend = 0.01;
  // [of the pipe radius that the fit starts with] By trial.
  double thinnest_pipe = 0.5, thickest_pipe = 2.0;
  // [of r_P] A term of Flattening, either way: eight times what is usual (kUsualFlattening).
  double flattening = 0.4;
  // [of r_P] Of the easing: so little moves no surface (0.05 did: radii of exact scans
  // were too small), and a bender's clamp and die are no longer
  // than a few pipe diameters.
  double least_easing = 0.005, most_easing = 3.0;
};
constexpr BoundSettings kBounds;

// Numbers that move a segment: those of the bends behind it do not.
std::vector<Eigen::Index> MovingNumbers(const Eigen::MatrixXd& derivative) {
  std::vector<Eigen::Index> moving;
  for (Eigen::Index i = 0; i < derivative.cols(); ++i) {
    if ((derivative.col(i).array() != 0.0).any()) moving.push_back(i);
  }
  return moving;
}

}  // namespace

NormalEquations::NormalEquations(const TubeParameters& parameters, const EasedSpine& spine,
                                 std::span<const CondensedSum> sums, const FitPriors& priors,
                                 double sigma_mm)
    : at(parameters.Initial()),
      matrix(Eigen::MatrixXd::Zero(parameters.size(), parameters.size())),
      right(Eigen::VectorXd::Zero(parameters.size())),
      variance_mm2(sigma_mm * sigma_mm) {
  const auto derivatives = parameters.FrameDerivatives(spine);
  for (std::size_t k = 0; k < derivatives.size(); ++k) {
    using OfState = Eigen::Matrix<double, kLocalState, Eigen::Dynamic>;
    const std::vector<Eigen::Index> moving = MovingNumbers(derivatives[k]);
    const OfState derivative = derivatives[k](Eigen::all, moving);
    const OfState weighted = sums[k].topLeftCorner<kLocalState, kLocalState>() * derivative;
    matrix(moving, moving) += derivative.transpose() * weighted;
    right(moving) -= derivative.transpose() * sums[k].col(kLocalState).head<kLocalState>();
    squares_mm2 += sums[k](kLocalState, kLocalState);
    weight += sums[k](kPipeRadiusState, kPipeRadiusState);
  }
  of_priors = Eigen::MatrixXd::Zero(parameters.size(), parameters.size());
  priors.Add(parameters, at, sigma_mm, of_priors, right);
  matrix += of_priors;
  of_priors /= variance_mm2;
  last_start = derivatives.back().row(0);
  scale = matrix.diagonal().cwiseSqrt();
  for (double& s : scale) s = s > 0 ? 1.0 / s : 0.0;
  scaled = scale.asDiagonal() * matrix * scale.asDiagonal();
  for (Eigen::Index i = 0; i < scale.size(); ++i) {
    if (scale[i] == 0) scaled(i, i) = 1.0;  // no point feels it: it stays
  }
}

double NormalEquations::Variance() const {
  return squares_mm2 / std::max(1.0, weight - static_cast<double>(right.size()));
}

Eigen::MatrixXd NormalEquations::Covariance(const TubeParameters& parameters, const hal::Tube& tube,
                                            double design_effect) const {
  const Eigen::Index size = right.size();
  const double variance = design_effect * Variance();
  Eigen::VectorXd range = ExpectedRange(parameters, tube.pipe_radius_mm);
  for (std::size_t bend = 0; bend < parameters.bends(); ++bend) {
    double& of_radius = range[parameters.bend_radius(bend)];
    of_radius = std::hypot(of_radius, at[parameters.bend_radius(bend)]);
  }
  Eigen::MatrixXd informed = scaled;
  informed.diagonal() += variance * scale.cwiseQuotient(range).cwiseAbs2();
  const Eigen::MatrixXd inverse = SolveSymmetric(informed, Eigen::MatrixXd::Identity(size, size));
  // Points are worth less than they were weighed by; what is known without them is as sure as it
  // is.
  const Eigen::MatrixXd of_known =
      variance_mm2 * scale.asDiagonal() * of_priors * scale.asDiagonal();
  const Eigen::MatrixXd scaled_covariance =
      variance * inverse - (variance - variance_mm2) * inverse * of_known * inverse;
  Eigen::MatrixXd covariance = scale.asDiagonal() * scaled_covariance * scale.asDiagonal();
  for (Eigen::Index i = 0; i < size; ++i) {
    if (scale[i] == 0) covariance(i, i) = range[i] * range[i];  // no more is known than before
  }
  return covariance;
}

FitBounds::FitBounds(const TubeParameters& parameters, double pipe_radius_mm, double max_length_mm)
    : low(Eigen::VectorXd::Constant(parameters.size(), -1e9)),
      high(Eigen::VectorXd::Constant(parameters.size(), 1e9)),
      step(Eigen::VectorXd::Constant(parameters.size(), max_length_mm)) {
  const auto bound = [&](int index, double from, double to) {
    low[index] = from;
    high[index] = to;
  };
  for (std::size_t i = 0; i < parameters.bends(); ++i) {
    bound(parameters.length(i), 0.0, max_length_mm);
    bound(parameters.angle(i), -kBounds.turn_back_rad, 2.0 * std::numbers::pi);
    step[parameters.angle(i)] = kBounds.step_rad;
    if (i > 0) step[parameters.rotation(i)] = kBounds.step_rad;
    const int radius = parameters.bend_radius(i);
    bound(radius,
          std::clamp(parameters.Initial()[radius], kBounds.tightest_bend * pipe_radius_mm,
                     pipe_radius_mm),
          kBounds.widest_bend * pipe_radius_mm);
  }
  if (parameters.pipe_radius() >= 0) {
    bound(parameters.pipe_radius(), kBounds.thinnest_pipe * pipe_radius_mm,
          kBounds.thickest_pipe * pipe_radius_mm);
  }
  for (std::size_t i = 0; i < parameters.bends(); ++i) {
    for (int k = 0; parameters.flattened() && k < kFlatteningParameters; ++k) {
      bound(parameters.flattening(i) + k, -kBounds.flattening, kBounds.flattening);
    }
    if (parameters.eased()) {
      bound(parameters.easing(i), std::pow(kBounds.least_easing * pipe_radius_mm, 2),
            std::pow(kBounds.most_easing * pipe_radius_mm, 2));
      bound(parameters.easing_reach(), kLeastReach, kMostReach);
      if (parameters.skewed()) bound(parameters.easing_skew(i), -kMostSkew, kMostSkew);
    }
  }
}

Eigen::VectorXd BoundedStep(const NormalEquations& equations, const FitBounds& bounds,
                            double damping) {
  const Eigen::Index size = equations.right.size();
  Eigen::VectorXd step = Eigen::VectorXd::Zero(size);  // in units of `scale`
  std::vector<bool> held(static_cast<std::size_t>(size), false);
  const auto is_held = [&held](Eigen::Index i) { return held[static_cast<std::size_t>(i)]; };
  Eigen::MatrixXd matrix;
  Eigen::VectorXd right;
  for (Eigen::Index round = 0; round < size; ++round) {
    matrix = equations.scaled;
    matrix.diagonal().array() += damping;
    right = equations.scale.asDiagonal() * equations.right;
    for (Eigen::Index i = 0; i < size; ++i) {
      if (!is_held(i)) continue;
      right -= step[i] * matrix.col(i);
    }
    for (Eigen::Index i = 0; i < size; ++i) {
      if (!is_held(i)) continue;
      matrix.row(i).setZero();
      matrix.col(i).setZero();
      matrix(i, i) = 1.0;
      right[i] = step[i];
    }
    const Eigen::VectorXd solved = SolveSymmetric(matrix, right);
    if (!solved.allFinite()) return Eigen::VectorXd::Zero(size);
    bool again = false;
    for (Eigen::Index i = 0; i < size; ++i) {
      if (is_held(i)) continue;
      step[i] = solved[i];
      if (equations.scale[i] <= 0) continue;
      const double at = equations.at[i];
      const double to = at + equations.scale[i] * step[i];
      const double low = bounds.Lowest(i, at), high = bounds.Highest(i, at);
      if (to >= low && to <= high) continue;
      step[i] = (std::clamp(to, low, high) - at) / equations.scale[i];
      held[static_cast<std::size_t>(i)] = true;
      again = true;
    }
    if (!again) break;
  }
  return equations.scale.asDiagonal() * step;
}

}  // namespace bendloop::pipeline
