// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace bendloop::pipeline {

// Eigen's solvers of dense matrices, compiled once: as templates they are most of the time that a
// file takes to compile. Not for what runs point by point: arguments of fixed size are copied to
// the heap.

// a^-1 (LU). `a`: square and not singular.
Eigen::MatrixXd Inverse(const Eigen::MatrixXd& a);

// x of a x = b (LDL^T with pivots). `a`: symmetric, positive or negative semidefinite.
Eigen::MatrixXd SolveSymmetric(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

// x for which |a x - b| is least (QR with pivots). `a`: at least as many rows as columns.
Eigen::VectorXd LeastSquares(const Eigen::MatrixXd& a, const Eigen::VectorXd& b);

// `a` = vectors diag(values) vectors^T.
struct EigenSystem {
  Eigen::VectorXd values;  // the least first
  Eigen::MatrixXd vectors;
};
EigenSystem SymmetricEigen(const Eigen::MatrixXd& a);

}  // namespace bendloop::pipeline
