// SPDX-License-Identifier: Apache-2.0
#include "pipeline/math/definite_solver.h"

#include <Eigen/Cholesky>

namespace bendloop::pipeline {

DefiniteSolver::DefiniteSolver(const Eigen::MatrixXd& a) {
  const Eigen::LLT<Eigen::MatrixXd> root(a);
  lower_ = root.matrixLLT();
  is_definite_ = root.info() == Eigen::Success;
}

Eigen::MatrixXd DefiniteSolver::Solve(const Eigen::MatrixXd& b) const {
  Eigen::MatrixXd x = b;
  lower_.triangularView<Eigen::Lower>().solveInPlace(x);
  lower_.transpose().triangularView<Eigen::Upper>().solveInPlace(x);
  return x;
}

double DefiniteSolver::LogDeterminant() const {
  return 2.0 * lower_.diagonal().array().log().sum();
}

double DefiniteSolver::Square(const Eigen::VectorXd& b) const {
  Eigen::VectorXd x = b;
  lower_.triangularView<Eigen::Lower>().solveInPlace(x);
  return x.squaredNorm();
}

}  // namespace bendloop::pipeline
