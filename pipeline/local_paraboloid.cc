// SPDX-License-Identifier: Apache-2.0
#include "pipeline/local_paraboloid.h"

#include <Eigen/Dense>
#include <cmath>

namespace bendloop::pipeline {
namespace {

constexpr std::size_t kMinSamples = 10;
// A neighbourhood narrower than this part of its length (standard deviations) is a line: one laser
// stripe says nothing of the surface across it.
constexpr double kMinAspect = 0.15;
constexpr double kMinCondition = 3e-4;

}  // namespace

std::optional<LocalParaboloid> FitLocalParaboloid(const Eigen::Vector3d& point,
                                                  std::span<const Eigen::Vector3d> candidates,
                                                  double radius_mm) {
  // Weighted covariance of the neighbours (2.1), coordinates relative to the sample.
  const double radius2 = radius_mm * radius_mm;
  const auto weight = [radius2](double distance2) {
    const double u = 1.0 - distance2 / radius2;
    return u * u;
  };
  std::size_t samples = 0;
  double sum_weight = 0;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d sum_outer = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& candidate : candidates) {
    const Eigen::Vector3d p = candidate - point;
    const double distance2 = p.squaredNorm();
    if (distance2 >= radius2) continue;
    const double w = weight(distance2);
    const Eigen::Vector3d wp = w * p;
    ++samples;
    sum_weight += w;
    sum += wp;
    sum_outer.noalias() += wp * p.transpose();
  }
  if (samples < kMinSamples) return std::nullopt;
  const Eigen::Vector3d mean = sum / sum_weight;
  const Eigen::Matrix3d covariance = sum_outer / sum_weight - mean * mean.transpose();
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen;
  eigen.computeDirect(covariance);
  const Eigen::Vector3d spread = eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  if (!(spread[1] > kMinAspect * spread[2])) return std::nullopt;
  const Eigen::Vector3d nu = eigen.eigenvectors().col(0);
  const Eigen::Vector3d ex = eigen.eigenvectors().col(2);
  const Eigen::Vector3d ey = nu.cross(ex);

  // z = a x^2 + b y^2 + c xy + d x + e y + f in units of the radius, which keeps the normal
  // equations well scaled.
  using Vector6d = Eigen::Matrix<double, 6, 1>;
  using Matrix6d = Eigen::Matrix<double, 6, 6>;
  Matrix6d normal_matrix = Matrix6d::Zero();
  Vector6d right = Vector6d::Zero();
  double sum_z2 = 0;
  const double inverse = 1.0 / radius_mm;
  for (const Eigen::Vector3d& candidate : candidates) {
    const Eigen::Vector3d p = candidate - point;
    const double distance2 = p.squaredNorm();
    if (distance2 >= radius2) continue;
    const double w = weight(distance2);
    const double x = p.dot(ex) * inverse;
    const double y = p.dot(ey) * inverse;
    const double z = p.dot(nu) * inverse;
    Vector6d row;
    row << x * x, y * y, x * y, x, y, 1.0;
    normal_matrix.selfadjointView<Eigen::Lower>().rankUpdate(row, w);
    right += (w * z) * row;
    sum_z2 += w * z * z;
  }
  const Eigen::LDLT<Matrix6d> ldlt(normal_matrix.selfadjointView<Eigen::Lower>());
  // Two laser stripes leave the curvature across them open; a third one settles it.
  if (ldlt.info() != Eigen::Success || !(ldlt.rcond() > kMinCondition)) return std::nullopt;
  const Vector6d k = ldlt.solve(right);
  if (!k.allFinite()) return std::nullopt;

  LocalParaboloid fit;
  fit.samples = samples;
  fit.rms_mm = radius_mm * std::sqrt(std::max(0.0, sum_z2 - k.dot(right)) / sum_weight);
  const double d = k[3];
  const double e = k[4];
  fit.foot_mm = point + radius_mm * k[5] * nu;
  fit.normal = (nu - d * ex - e * ey).normalized();

  // Shape operator S = G^-1 H (2.2).
  Eigen::Matrix2d g;
  g << d * d + 1.0, d * e, d * e, e * e + 1.0;
  Eigen::Matrix2d h;
  h << 2.0 * k[0], k[2], k[2], 2.0 * k[1];
  h *= inverse / std::sqrt(1.0 + d * d + e * e);
  const Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::Matrix2d> shape(h, g);
  if (shape.info() != Eigen::Success) return std::nullopt;
  const int first = std::abs(shape.eigenvalues()[0]) > std::abs(shape.eigenvalues()[1]) ? 0 : 1;
  for (int i = 0; i < 2; ++i) {
    const int column = i == 0 ? first : 1 - first;
    const Eigen::Vector2d v = shape.eigenvectors().col(column);
    fit.curvature[static_cast<std::size_t>(i)] = shape.eigenvalues()[column];
    // The tangent vector above (x, y) on the graph.
    fit.direction[static_cast<std::size_t>(i)] =
        (v.x() * (ex + d * nu) + v.y() * (ey + e * nu)).normalized();
  }
  return fit;
}

}  // namespace bendloop::pipeline
