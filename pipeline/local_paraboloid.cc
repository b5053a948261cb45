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
  // Weighted moments: m_ij of x^i y^j, z_ij of z x^i y^j.
  double m00 = 0, m10 = 0, m01 = 0, m20 = 0, m11 = 0, m02 = 0, m30 = 0, m21 = 0, m12 = 0, m03 = 0,
         m40 = 0, m31 = 0, m22 = 0, m13 = 0, m04 = 0;
  double z00 = 0, z10 = 0, z01 = 0, z20 = 0, z11 = 0, z02 = 0;
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
    const double x2 = x * x, xy = x * y, y2 = y * y;
    const double wx2 = w * x2, wxy = w * xy, wy2 = w * y2;
    m00 += w, m10 += w * x, m01 += w * y;
    m20 += wx2, m11 += wxy, m02 += wy2;
    m30 += wx2 * x, m21 += wx2 * y, m12 += wy2 * x, m03 += wy2 * y;
    m40 += wx2 * x2, m31 += wx2 * xy, m22 += wx2 * y2, m13 += wxy * y2, m04 += wy2 * y2;
    z00 += w * z, z10 += w * z * x, z01 += w * z * y;
    z20 += wx2 * z, z11 += wxy * z, z02 += wy2 * z;
    sum_z2 += w * z * z;
  }
  Matrix6d normal_matrix;
  normal_matrix << m40, m22, m31, m30, m21, m20,  //
      m22, m04, m13, m12, m03, m02,               //
      m31, m13, m22, m21, m12, m11,               //
      m30, m12, m21, m20, m11, m10,               //
      m21, m03, m12, m11, m02, m01,               //
      m20, m02, m11, m10, m01, m00;
  Vector6d right;
  right << z20, z02, z11, z10, z01, z00;
  const Eigen::LDLT<Matrix6d> ldlt(normal_matrix);
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
