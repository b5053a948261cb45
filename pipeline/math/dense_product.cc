// SPDX-License-Identifier: Apache-2.0
#include "pipeline/math/dense_product.h"

namespace bendloop::pipeline {

Eigen::MatrixXd Product(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) { return a * b; }

Eigen::MatrixXd TransposeProduct(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  return a.transpose() * b;
}

Eigen::MatrixXd Mapped(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  return Product(a, TransposeProduct(b, a.transpose()));
}

}  // namespace bendloop::pipeline
