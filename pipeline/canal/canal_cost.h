// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ceres/cost_function.h>
#include <ceres/sized_cost_function.h>

#include <Eigen/Core>

#include "pipeline/canal/span_sums.h"

namespace bendloop::pipeline {

// Cost functions of the canal fit, for Ceres. Derivatives are analytic.

// A span's sums as residuals: 17 numbers whose square sum is the loss of all points nearest to the
// span, with its gradient and Gauss-Newton matrix. Unknowns: the centres of four control points,
// then their radii, or one radius for all. `sums` are those of the unknowns that Ceres asks about:
// an EvaluationCallback keeps them so.
class SpanCost final : public ceres::CostFunction {
 public:
  SpanCost(const std::vector<SpanSums>& spans, std::size_t span, bool varying_radius);
  bool Evaluate(double const* const* unknowns, double* residuals,
                double** jacobians) const override;

 private:
  const std::vector<SpanSums>& spans_;
  std::size_t span_;
  bool varying_radius_;
};

// Keeps control points that no point speaks for in line: third differences of four in a row.
template <int kSize>
class ThirdDifference final : public ceres::SizedCostFunction<kSize, kSize, kSize, kSize, kSize> {
 public:
  explicit ThirdDifference(double root_weight) : root_weight_(root_weight) {}
  bool Evaluate(double const* const* unknowns, double* residuals,
                double** jacobians) const override {
    constexpr double kThird[] = {-1, 3, -3, 1};
    Eigen::Map<Eigen::Matrix<double, kSize, 1>> difference(residuals);
    difference.setZero();
    for (int a = 0; a < 4; ++a) {
      using Square = Eigen::Matrix<double, kSize, kSize>;
      difference +=
          root_weight_ * kThird[a] * Eigen::Map<const Eigen::Matrix<double, kSize, 1>>(unknowns[a]);
      if (jacobians && jacobians[a]) {
        Eigen::Map<Square> jacobian(jacobians[a]);  // symmetric: its order does not matter
        jacobian = root_weight_ * kThird[a] * Square::Identity();
      }
    }
    return true;
  }

 private:
  double root_weight_;
};

// Holds a centre along the spine, where moving it changes nothing but the knots.
class AlongSpine final : public ceres::SizedCostFunction<1, 3> {
 public:
  AlongSpine(double root_weight, const Eigen::Vector3d& tangent, const Eigen::Vector3d& place_mm)
      : row_(root_weight * tangent), place_mm_(place_mm) {}
  bool Evaluate(double const* const* unknowns, double* residuals,
                double** jacobians) const override;

 private:
  Eigen::Vector3d row_, place_mm_;
};

}  // namespace bendloop::pipeline
