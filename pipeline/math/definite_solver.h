// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace bendloop::pipeline {

// a x = b for several b, where `a` is symmetric and positive definite (Cholesky's factors, of
// which only the lower triangle is looked at). Compiled once, as dense_solve.h is.
class DefiniteSolver {
 public:
  explicit DefiniteSolver(const Eigen::MatrixXd& a);

  // False: `a` is not positive definite, and nothing else may be asked.
  bool is_definite() const { return is_definite_; }
  Eigen::MatrixXd Solve(const Eigen::MatrixXd& b) const;
  // L of L L^T = a.
  Eigen::MatrixXd Lower() const { return lower_.triangularView<Eigen::Lower>(); }
  // The logarithm of the determinant of `a`.
  double LogDeterminant() const;
  // b^T a^-1 b.
  double Square(const Eigen::VectorXd& b) const;

 private:
  Eigen::MatrixXd lower_;  // L in its lower triangle
  bool is_definite_;
};

}  // namespace bendloop::pipeline
