// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/fit_priors.h"

#include <Eigen/Dense>
#include <cmath>
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
  const int own = parameters.flattening(0);  // from there on
  range.tail(parameters.size() - own).setConstant(std::numeric_limits<double>::infinity());
  return range;
}

void FitPriors::Add(const TubeParameters& parameters, const Eigen::VectorXd& at, double sigma_mm,
                    Eigen::MatrixXd& matrix, Eigen::VectorXd& right) const {
  const auto add = [&](Eigen::Index i, double deviation, double usual, double weight) {
    const double certainty = weight * sigma_mm * sigma_mm / (usual * usual);
    matrix(i, i) += certainty;
    right[i] -= certainty * deviation;
  };
  for (std::size_t bend = 0; parameters.flattened() && bend < parameters.bends(); ++bend) {
    const Eigen::Vector4d range = FlatteningRange();
    for (int k = 0; k < kFlatteningParameters; ++k) {
      add(parameters.flattening(bend) + k, at[parameters.flattening(bend) + k], range[k], 1.0);
    }
  }
  if (parameters.eased()) {
    const auto bends = static_cast<Eigen::Index>(parameters.bends());
    const Eigen::Index first = parameters.easing(0);
    const Eigen::VectorXd easing = at.segment(first, bends);
    const double mean = easing.mean();
    const double certainty = std::pow(sigma_mm / (easings_alike * mean), 2);
    Eigen::MatrixXd alike = Eigen::MatrixXd::Identity(bends, bends);
    alike.array() -= 1.0 / static_cast<double>(bends);
    matrix.block(first, first, bends, bends) += certainty * alike;
    right.segment(first, bends) -= certainty * (alike * easing);
    add(parameters.easing_reach(), at[parameters.easing_reach()] - kUsualReach, kReachSigma, 1.0);
    for (std::size_t bend = 0; parameters.skewed() && bend < parameters.bends(); ++bend) {
      add(parameters.easing_skew(bend), at[parameters.easing_skew(bend)], kSkewSigma, 1.0);
    }
  }
  if (radii_alike > 0) {
    std::vector<int> radii;
    double sum_mm = 0;
    for (std::size_t i = 0; i < parameters.bends(); ++i) {
      if (IsOdd(i)) continue;
      radii.push_back(parameters.bend_radius(i));
      sum_mm += at[radii.back()];
    }
    const auto bends = static_cast<double>(radii.size());
    const double mean_mm = sum_mm / bends;
    const double certainty = std::pow(sigma_mm / (radii_alike * mean_mm), 2);
    for (const int i : radii) {
      right[i] -= certainty * (at[i] - mean_mm);
      for (const int k : radii) matrix(i, k) += certainty * ((i == k ? 1.0 : 0.0) - 1.0 / bends);
    }
  }
  if (!bend_radius) return;
  for (std::size_t bend = 0; bend < parameters.bends(); ++bend) {
    if (IsOdd(bend)) continue;
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
    if (IsOdd(bend)) continue;
    const int i = parameters.bend_radius(bend);
    const double deviation_mm = *tube.program.rows[bend].bend_radius_mm - bend_radius->mean_mm;
    if (RobustWeight(deviation_mm, bend_radius->sigma_mm) < 0.5) continue;
    range[i] = bend_radius->sigma_mm;
    counted[i] = 1;
  }
  const Eigen::Index own = parameters.size() - parameters.flattening(0);
  range.tail(own).setConstant(kUsualFlattening);
  counted.tail(own).setOnes();
  if (parameters.eased()) {
    const auto bends = static_cast<Eigen::Index>(parameters.bends());
    range.segment(parameters.easing(0), bends)
        .setConstant(tube.pipe_radius_mm * tube.pipe_radius_mm);
    range[parameters.easing_reach()] = kReachSigma;
    if (parameters.skewed()) range.tail(bends).setConstant(kSkewSigma);
  }
  Eigen::MatrixXd ratio = range.asDiagonal() * (matrix / variance_mm2) * range.asDiagonal();
  ratio.diagonal() += Eigen::VectorXd::Ones(parameters.size()) - counted;
  const Eigen::VectorXd pivots = ratio.ldlt().vectorD();
  return pivots.cwiseMax(1.0).array().log().sum();
}

Eigen::Vector4d FitPriors::FlatteningRange() const {
  static_assert(kFlatteningParameters == 4);
  return {kUsualFlattening, kUsualFlattening, sunk, sunk};
}

std::optional<double> FitPriors::MeanRadiusMm(const hal::BendProgram& program) const {
  double radii = 0, sum_mm = 0;
  for (std::size_t i = 0; i < program.bend_count(); ++i) {
    if (IsOdd(i)) continue;
    radii += 1;
    sum_mm += program.rows[i].bend_radius_mm.value_or(0.0);
  }
  return radii > 0 ? std::optional(sum_mm / radii) : std::nullopt;
}

double FitPriors::ChiSquare(const hal::BendProgram& program, std::span<const Flattening> flattening,
                            const Easing& easing) const {
  double sum = 0;
  double mean_mm2 = 0;
  const auto bends = static_cast<double>(easing.variance_mm2.size());
  for (const double variance : easing.variance_mm2) mean_mm2 += variance / bends;
  for (const double variance : easing.variance_mm2) {
    sum += std::pow((variance - mean_mm2) / (easings_alike * mean_mm2), 2);
  }
  if (!easing.empty()) sum += std::pow((easing.reach - kUsualReach) / kReachSigma, 2);
  for (const double skew : easing.skew) sum += std::pow(skew / kSkewSigma, 2);
  for (const Flattening& f : flattening) {
    const Eigen::Vector4d numbers(f.constant, f.bump, f.collapse, f.plateau);
    sum += numbers.cwiseQuotient(FlatteningRange()).squaredNorm();
  }
  const auto mean_mm = MeanRadiusMm(program);
  for (std::size_t i = 0; radii_alike > 0 && mean_mm && i < program.bend_count(); ++i) {
    if (IsOdd(i)) continue;
    const double off_mm = program.rows[i].bend_radius_mm.value_or(0.0) - *mean_mm;
    sum += std::pow(off_mm / (radii_alike * *mean_mm), 2);
  }
  for (std::size_t bend = 0; bend_radius && bend < program.bend_count(); ++bend) {
    if (IsOdd(bend)) continue;
    const double radius_mm = program.rows[bend].bend_radius_mm.value_or(bend_radius->mean_mm);
    sum += RobustSum(radius_mm - bend_radius->mean_mm, bend_radius->sigma_mm);
  }
  return sum;
}

}  // namespace bendloop::pipeline
