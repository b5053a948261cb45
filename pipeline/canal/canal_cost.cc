// SPDX-License-Identifier: Apache-2.0
#include "pipeline/canal/canal_cost.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace bendloop::pipeline {
namespace {

constexpr int kRows = SpanSums::kUnknowns + 1;

using Factor = Eigen::Matrix<double, kRows, SpanSums::kUnknowns>;
using Residuals = Eigen::Matrix<double, kRows, 1>;

// J and r with J'J = matrix, J'r = gradient, r'r = loss. The matrix is P' L D L' P; where D is
// nothing, so is the gradient. What r'r lacks stands in the last row, which nothing moves: a loss
// is never less than what the best step of its own quadratic form can take off it.
void Factorise(const SpanSums& sums, Factor& J, Residuals& r) {
  const Eigen::LDLT<SpanSums::Matrix> ldlt(sums.matrix);
  const SpanSums::Vector D = ldlt.vectorD();
  const double least = 1e-12 * std::max(D.cwiseAbs().maxCoeff(), 1e-300);
  SpanSums::Matrix factor = ldlt.matrixL();
  SpanSums::Vector y = ldlt.transpositionsP() * sums.gradient;
  ldlt.matrixL().solveInPlace(y);
  for (int i = 0; i < SpanSums::kUnknowns; ++i) {
    const double root = D[i] > least ? std::sqrt(D[i]) : 0.0;
    factor.col(i) *= root;
    r[i] = root > 0 ? y[i] / root : 0.0;
  }
  const SpanSums::Matrix transposed = ldlt.transpositionsP().transpose() * factor;
  J.topRows<SpanSums::kUnknowns>() = transposed.transpose();
  J.row(SpanSums::kUnknowns).setZero();
  const double explained_mm2 = r.head<SpanSums::kUnknowns>().squaredNorm();
  r[SpanSums::kUnknowns] = std::sqrt(std::max(0.0, sums.loss_mm2 - explained_mm2));
}

}  // namespace

SpanCost::SpanCost(const std::vector<SpanSums>& spans, std::size_t span, bool varying_radius)
    : spans_(spans), span_(span), varying_radius_(varying_radius) {
  set_num_residuals(kRows);
  for (int a = 0; a < 4; ++a) mutable_parameter_block_sizes()->push_back(3);
  for (int a = 0; a < (varying_radius ? 4 : 1); ++a) mutable_parameter_block_sizes()->push_back(1);
}

bool SpanCost::Evaluate(double const* const*, double* residuals, double** jacobians) const {
  Factor J;
  Residuals r;
  Factorise(spans_[span_], J, r);
  Eigen::Map<Residuals>(residuals, kRows) = r;
  if (!jacobians) return true;
  using OfCenter = Eigen::Matrix<double, kRows, 3, Eigen::RowMajor>;
  for (int a = 0; a < 4; ++a) {
    if (jacobians[a]) Eigen::Map<OfCenter>(jacobians[a], kRows, 3) = J.middleCols<3>(4 * a);
  }
  if (!varying_radius_) {
    if (jacobians[4]) {
      Eigen::Map<Residuals>(jacobians[4], kRows) = J.col(3) + J.col(7) + J.col(11) + J.col(15);
    }
    return true;
  }
  for (int a = 0; a < 4; ++a) {
    if (jacobians[4 + a]) Eigen::Map<Residuals>(jacobians[4 + a], kRows) = J.col(4 * a + 3);
  }
  return true;
}

bool AlongSpine::Evaluate(double const* const* unknowns, double* residuals,
                          double** jacobians) const {
  residuals[0] = row_.dot(Eigen::Map<const Eigen::Vector3d>(unknowns[0]) - place_mm_);
  if (jacobians && jacobians[0]) Eigen::Map<Eigen::Vector3d>(jacobians[0], 3) = row_;
  return true;
}

}  // namespace bendloop::pipeline
