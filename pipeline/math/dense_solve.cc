// SPDX-License-Identifier: Apache-2.0
#include "pipeline/math/dense_solve.h"

#include <Eigen/Dense>

namespace bendloop::pipeline {

Eigen::MatrixXd Inverse(const Eigen::MatrixXd& a) { return a.inverse(); }

Eigen::MatrixXd SolveSymmetric(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  return a.ldlt().solve(b);
}

Eigen::VectorXd LeastSquares(const Eigen::MatrixXd& a, const Eigen::VectorXd& b) {
  return a.colPivHouseholderQr().solve(b);
}

EigenSystem SymmetricEigen(const Eigen::MatrixXd& a) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(a);
  return {eigen.eigenvalues(), eigen.eigenvectors()};
}

}  // namespace bendloop::pipeline
