// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "pipeline/canal/canal_surface.h"

namespace bendloop::pipeline {

// All that least squares needs of the points nearest to one span of the spline, however many: their
// distances depend on the span's four control points (x, y, z, radius each) and nothing else.
struct SpanSums {
  static constexpr int kUnknowns = 16;
  using Matrix = Eigen::Matrix<double, kUnknowns, kUnknowns>;
  using Vector = Eigen::Matrix<double, kUnknowns, 1>;

  Matrix matrix = Matrix::Zero();    // sum of weight * outer(derivative of the distance)
  Vector gradient = Vector::Zero();  // sum of weight * distance * derivative [mm]
  double loss_mm2 = 0;               // sum of the loss that has these weights
};

// Distances of the points from the surface, and their sums under Tukey's biweight loss
// cut^2 / 3 (1 - (1 - (d / cut)^2)^3), which is d^2 for small distances and constant from `cut` on.
class CanalDistances {
 public:
  CanalDistances(std::span<const Eigen::Vector3d> points, std::vector<CanalFoot> feet)
      : points_(points), feet_(std::move(feet)) {}

  // Follows the points' feet to the surface, which has moved a little.
  void Follow(const CanalSurface& surface);
  // Robust standard deviation of the distances within reach [mm]; 0: there are none.
  double SigmaMm(double reach_mm) const;
  // The sums of the spans at the present feet.
  void Sum(const CanalSurface& surface, double cut_mm);

  const std::vector<CanalFoot>& feet() const { return feet_; }
  const std::vector<SpanSums>& spans() const { return spans_; }
  double weight() const { return weight_; }  // sum over the points

 private:
  std::span<const Eigen::Vector3d> points_;
  std::vector<CanalFoot> feet_;
  std::vector<SpanSums> spans_;
  double weight_ = 0;
};

}  // namespace bendloop::pipeline
