// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace bendloop::pipeline {

// Eigen's products of dense matrices, compiled once: a file with a few of them of its own takes
// half a minute to compile. Not for what runs point by point: arguments of fixed size are copied to
// the heap. Sizes fit, as with Eigen's own.

// a b.
Eigen::MatrixXd Product(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

// a^T b.
Eigen::MatrixXd TransposeProduct(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

// a b a^T: the covariance `b` of what `a` maps. `b`: symmetric.
Eigen::MatrixXd Mapped(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

}  // namespace bendloop::pipeline
