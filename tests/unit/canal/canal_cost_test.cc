// SPDX-License-Identifier: Apache-2.0
#include "pipeline/canal/canal_cost.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>
#include <vector>

namespace bendloop::pipeline {
namespace {

using Unknowns = Eigen::VectorXd;

// Points around a bent, tapered pipe, some far from it.
struct Scene {
  explicit Scene(int seed) {
    std::mt19937 random(static_cast<unsigned>(seed));
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform(0, 1);
    std::vector<Eigen::Vector4d> control;
    for (int c = 0; c < 6; ++c) control.emplace_back(10 * c, 0.8 * c * c, 0, 4 + 0.1 * c);
    surface = CanalSurface(control);
    for (int i = 0; i < 200; ++i) {
      const double t = 3 * uniform(random);
      const Eigen::Vector4d c = surface.At(t);
      const Eigen::Vector3d out =
          surface.DerivativeAt(t)
              .head<3>()
              .cross(Eigen::Vector3d(normal(random), normal(random), normal(random)))
              .normalized();
      points.push_back(c.head<3>() + (c[3] + 0.3 * normal(random)) * out);
      feet.push_back({t, 0, false});
    }
  }
  // Loss of all points where the control points are moved by `step`.
  double LossAt(const Unknowns& step, double cut_mm) const {
    CanalSurface moved = surface;
    for (int i = 0; i < step.size(); ++i) {
      moved.control()[static_cast<std::size_t>(i / 4)][i % 4] += step[i];
    }
    CanalDistances distances(points, feet);
    for (int i = 0; i < 20; ++i) distances.Follow(moved);
    distances.Sum(moved, cut_mm);
    double loss = 0;
    for (const SpanSums& sums : distances.spans()) loss += sums.loss_mm2;
    return loss;
  }

  CanalSurface surface;
  std::vector<Eigen::Vector3d> points;
  std::vector<CanalFoot> feet;
};

// Residuals and Jacobian of a span as one would have them from the sums' definition.
struct Evaluated {
  Eigen::VectorXd r;
  Eigen::MatrixXd J;  // columns: x, y, z, radius of the four control points
};

Evaluated EvaluateSpan(const std::vector<SpanSums>& spans, std::size_t span) {
  const SpanCost cost(spans, span, true);
  std::vector<std::vector<double>> blocks;
  std::vector<double*> jacobians;
  for (const int size : cost.parameter_block_sizes()) {
    blocks.emplace_back(static_cast<std::size_t>(size * cost.num_residuals()));
  }
  for (auto& block : blocks) jacobians.push_back(block.data());
  Evaluated out{Eigen::VectorXd(cost.num_residuals()), Eigen::MatrixXd(cost.num_residuals(), 16)};
  EXPECT_TRUE(cost.Evaluate(nullptr, out.r.data(), jacobians.data()));
  for (int row = 0; row < cost.num_residuals(); ++row) {
    for (int a = 0; a < 4; ++a) {
      for (int k = 0; k < 3; ++k) {
        out.J(row, 4 * a + k) =
            blocks[static_cast<std::size_t>(a)][static_cast<std::size_t>(3 * row + k)];
      }
      out.J(row, 4 * a + 3) =
          blocks[static_cast<std::size_t>(4 + a)][static_cast<std::size_t>(row)];
    }
  }
  return out;
}

TEST(CanalCost, ResidualsStandForAllPointsOfASpan) {
  for (int seed = 1; seed <= 5; ++seed) {
    Scene scene(seed);
    CanalDistances distances(scene.points, scene.feet);
    for (int i = 0; i < 20; ++i) distances.Follow(scene.surface);
    distances.Sum(scene.surface, 0.7);
    for (std::size_t s = 0; s < distances.spans().size(); ++s) {
      const SpanSums& sums = distances.spans()[s];
      const auto [r, J] = EvaluateSpan(distances.spans(), s);
      const double size = sums.matrix.norm();
      EXPECT_NEAR(r.squaredNorm(), sums.loss_mm2, 1e-9 * sums.loss_mm2);
      EXPECT_LT((J.transpose() * J - sums.matrix).norm(), 1e-9 * size);
      EXPECT_LT((J.transpose() * r - sums.gradient).norm(), 1e-8 * size);
    }
  }
}

// The derivative of the loss, feet and all, is the gradient of the sums.
TEST(CanalCost, GradientIsThatOfTheLoss) {
  Scene scene(7);
  constexpr double kCutMm = 0.7, kStepMm = 1e-5;
  CanalDistances distances(scene.points, scene.feet);
  for (int i = 0; i < 20; ++i) distances.Follow(scene.surface);
  distances.Sum(scene.surface, kCutMm);
  Unknowns gradient = Unknowns::Zero(24);
  for (std::size_t s = 0; s < distances.spans().size(); ++s) {
    gradient.segment<16>(4 * static_cast<Eigen::Index>(s)) += distances.spans()[s].gradient;
  }
  for (int i = 0; i < gradient.size(); ++i) {
    Unknowns step = Unknowns::Zero(24);
    step[i] = kStepMm;
    const double slope = (scene.LossAt(step, kCutMm) - scene.LossAt(-step, kCutMm)) / (2 * kStepMm);
    EXPECT_NEAR(0.5 * slope, gradient[i], 1e-4 * gradient.norm()) << i;
  }
}

}  // namespace
}  // namespace bendloop::pipeline
