// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/local_paraboloid.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory>

#include "pipeline/math/ball_lanes.h"
#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

// Which neighbourhoods tell a surface. By trial.
struct ParaboloidSettings {
  // A paraboloid has six numbers; fewer samples than this follow the noise.
  std::size_t least_samples = 10;
  // A neighbourhood narrower than this part of its length (standard deviations) is a line: one
  // laser stripe says nothing of the surface across it.
  double least_aspect = 0.15;
  // 1 / (|a| |a^-1|) of the normal equations, in the norm of column sums: two laser stripes leave
  // the curvature across them open and are below; a third one settles it.
  double least_condition = 3e-4;
};
constexpr ParaboloidSettings kParaboloid;

// The neighbours relative to the sample as arrays, in units of the radius; filled up with points of
// no weight to whole registers.
class Neighbours {
 public:
  Neighbours(const Eigen::Vector3d& point, std::span<const Eigen::Vector3d> candidates,
             double radius_mm)
      : room_(candidates.size() + 3) {
    if (room_ > kUsual) {
      many_ = std::make_unique_for_overwrite<double[]>(3 * room_);
      values_ = many_.get();
    }
    count_ = GatherInBall(candidates, point, 1.0 / radius_mm, {lane(0), lane(1), lane(2)});
    size_ = (count_ + 3) / 4 * 4;
    for (std::size_t i = count_; i < size_; ++i) lane(0)[i] = lane(1)[i] = lane(2)[i] = 1.0;
  }
  Neighbours(const Neighbours&) = delete;
  Neighbours& operator=(const Neighbours&) = delete;
  std::size_t count() const { return count_; }
  std::size_t size() const { return size_; }
  double* lane(std::size_t i) { return values_ + i * room_; }
  const double* lane(std::size_t i) const { return values_ + i * room_; }

 private:
  static constexpr std::size_t kUsual = 400;  // more go to the heap
  std::array<double, 3 * kUsual> few_;        // not initialised: most is never looked at
  std::unique_ptr<double[]> many_;
  double* values_ = few_.data();
  std::size_t room_;
  std::size_t count_ = 0;
  std::size_t size_ = 0;
};

BENDLOOP_LOOP double Weight(double x, double y, double z) {
  const double u = 1.0 - (x * x + y * y + z * z);
  return u > 0 ? u * u : 0.0;
}

struct Covariance {
  double w = 0, x = 0, y = 0, z = 0, xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
};

BENDLOOP_LOOP Covariance SumCovarianceBody(const Neighbours& points) {
  const double *px = points.lane(0), *py = points.lane(1), *pz = points.lane(2);
  double w0 = 0, sx = 0, sy = 0, sz = 0, xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
  const std::size_t size = points.size();
#pragma omp simd reduction(+ : w0, sx, sy, sz, xx, xy, xz, yy, yz, zz)
  for (std::size_t i = 0; i < size; ++i) {
    const double w = Weight(px[i], py[i], pz[i]);
    const double wx = w * px[i], wy = w * py[i], wz = w * pz[i];
    w0 += w, sx += wx, sy += wy, sz += wz;
    xx += wx * px[i], xy += wx * py[i], xz += wx * pz[i];
    yy += wy * py[i], yz += wy * pz[i], zz += wz * pz[i];
  }
  return {w0, sx, sy, sz, xx, xy, xz, yy, yz, zz};
}
BENDLOOP_MULTIVERSION(Covariance, SumCovariance, (const Neighbours& points), (points))

// Weighted moments: m_ij of x^i y^j, z_ij of z x^i y^j.
struct Moments {
  double m00 = 0, m10 = 0, m01 = 0, m20 = 0, m11 = 0, m02 = 0, m30 = 0, m21 = 0, m12 = 0, m03 = 0;
  double m40 = 0, m31 = 0, m22 = 0, m13 = 0, m04 = 0;
  double z00 = 0, z10 = 0, z01 = 0, z20 = 0, z11 = 0, z02 = 0, zz = 0;
};

BENDLOOP_LOOP Moments SumMomentsBody(const Neighbours& points, const Eigen::Matrix3d& axes) {
  const double *px = points.lane(0), *py = points.lane(1), *pz = points.lane(2);
  const double ax = axes(0, 0), ay = axes(1, 0), az = axes(2, 0);
  const double bx = axes(0, 1), by = axes(1, 1), bz = axes(2, 1);
  const double cx = axes(0, 2), cy = axes(1, 2), cz = axes(2, 2);
  double m00 = 0, m10 = 0, m01 = 0, m20 = 0, m11 = 0, m02 = 0, m30 = 0, m21 = 0, m12 = 0, m03 = 0;
  double m40 = 0, m31 = 0, m22 = 0, m13 = 0, m04 = 0;
  double z00 = 0, z10 = 0, z01 = 0, z20 = 0, z11 = 0, z02 = 0, zz = 0;
  const std::size_t size = points.size();
#pragma omp simd reduction(+ : m00, m10, m01, m20, m11, m02, m30, m21, m12, m03, m40, m31, m22, \
                               m13, m04, z00, z10, z01, z20, z11, z02, zz)
  for (std::size_t i = 0; i < size; ++i) {
    const double w = Weight(px[i], py[i], pz[i]);
    const double x = px[i] * ax + py[i] * ay + pz[i] * az;
    const double y = px[i] * bx + py[i] * by + pz[i] * bz;
    const double z = px[i] * cx + py[i] * cy + pz[i] * cz;
    const double x2 = x * x, xy = x * y, y2 = y * y;
    const double wx2 = w * x2, wxy = w * xy, wy2 = w * y2;
    m00 += w, m10 += w * x, m01 += w * y;
    m20 += wx2, m11 += wxy, m02 += wy2;
    m30 += wx2 * x, m21 += wx2 * y, m12 += wy2 * x, m03 += wy2 * y;
    m40 += wx2 * x2, m31 += wx2 * xy, m22 += wx2 * y2, m13 += wxy * y2, m04 += wy2 * y2;
    z00 += w * z, z10 += w * z * x, z01 += w * z * y;
    z20 += wx2 * z, z11 += wxy * z, z02 += wy2 * z;
    zz += w * z * z;
  }
  return {m00, m10, m01, m20, m11, m02, m30, m21, m12, m03, m40,
          m31, m22, m13, m04, z00, z10, z01, z20, z11, z02, zz};
}
BENDLOOP_MULTIVERSION(Moments, SumMoments, (const Neighbours& points, const Eigen::Matrix3d& axes),
                      (points, axes))

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

// Solves a x = b for a symmetric positive definite matrix; false when that is so badly determined
// that 1 / (|a| |a^-1|), in the norm of column sums, is below `least_condition`.
bool SolveWellConditioned(const Matrix6d& a, const Vector6d& b, double least_condition,
                          Vector6d& x) {
  // Cholesky, then the inverse of its factor: it is wanted as a whole for the norm.
  double l[6][6], inverse[6][6];
  for (int j = 0; j < 6; ++j) {
    double d = a(j, j);
    for (int k = 0; k < j; ++k) d -= l[j][k] * l[j][k];
    if (!(d > 0)) return false;
    const double of_diagonal = 1.0 / std::sqrt(d);
    inverse[j][j] = of_diagonal;
    for (int i = j + 1; i < 6; ++i) {
      double v = a(i, j);
      for (int k = 0; k < j; ++k) v -= l[i][k] * l[j][k];
      l[i][j] = v * of_diagonal;
    }
  }
  for (int j = 0; j < 6; ++j) {
    for (int i = j + 1; i < 6; ++i) {
      double v = 0;
      for (int k = j; k < i; ++k) v -= l[i][k] * inverse[k][j];
      inverse[i][j] = v * inverse[i][i];
    }
  }
  double norm = 0, inverse_norm = 0;
  for (int j = 0; j < 6; ++j) {
    double sum = 0, column = 0, inverse_column = 0;
    for (int i = 0; i < 6; ++i) {
      double v = 0;
      for (int k = std::max(i, j); k < 6; ++k) v += inverse[k][i] * inverse[k][j];
      sum += v * b[i];
      column += std::abs(a(i, j));
      inverse_column += std::abs(v);
    }
    x[j] = sum;
    norm = std::max(norm, column);
    inverse_norm = std::max(inverse_norm, inverse_column);
  }
  return norm * inverse_norm * least_condition < 1.0 && x.allFinite();
}

// Principal curvatures and directions of z = k0 x^2 + k1 y^2 + k2 xy + k3 x + k4 y + k5, all in
// units of the radius, at its foot. Shape operator S = G^-1 H (2.2): H in an orthonormal frame of
// the tangent plane, one vector of which goes uphill, where the plane of x and y turns into it by a
// stretch alone.
void SetCurvature(const Vector6d& k, const Eigen::Matrix3d& axes, double radius_mm,
                  LocalParaboloid& fit) {
  const Eigen::Vector3d ex = axes.col(0), ey = axes.col(1), nu = axes.col(2);
  const double d = k[3];
  const double e = k[4];
  const double rise = std::hypot(d, e), stretch = std::hypot(1.0, rise);
  const double ux = rise > 0 ? d / rise : 1.0;
  const double uy = rise > 0 ? e / rise : 0.0;
  const Eigen::Vector3d uphill = (ux * ex + uy * ey + rise * nu) / stretch;
  const Eigen::Vector3d level = ux * ey - uy * ex;
  const double unit = 1.0 / (radius_mm * stretch);
  const double hxx = 2.0 * k[0] * unit, hxy = k[2] * unit, hyy = 2.0 * k[1] * unit;
  const double h_uphill =
      (hxx * ux * ux + 2.0 * hxy * ux * uy + hyy * uy * uy) / (stretch * stretch);
  const double h_mixed = ((hyy - hxx) * ux * uy + hxy * (ux * ux - uy * uy)) / stretch;
  const double h_level = hxx * uy * uy - 2.0 * hxy * ux * uy + hyy * ux * ux;
  const double mean_curvature = 0.5 * (h_uphill + h_level);
  const double half = 0.5 * (h_uphill - h_level);
  const double apart = std::hypot(half, h_mixed);
  // The direction of the greater eigenvalue, computed without a difference of like numbers.
  Eigen::Vector2d v =
      half >= 0 ? Eigen::Vector2d(apart + half, h_mixed) : Eigen::Vector2d(h_mixed, apart - half);
  const double length = v.norm();
  v = length > 0 ? Eigen::Vector2d(v / length) : Eigen::Vector2d(1.0, 0.0);
  const Eigen::Vector3d greater = v.x() * uphill + v.y() * level;
  const Eigen::Vector3d lesser = v.x() * level - v.y() * uphill;
  if (mean_curvature >= 0) {
    fit.curvature = {mean_curvature + apart, mean_curvature - apart};
    fit.direction = {greater, lesser};
  } else {
    fit.curvature = {mean_curvature - apart, mean_curvature + apart};
    fit.direction = {lesser, greater};
  }
}

}  // namespace

std::optional<LocalParaboloid> FitLocalParaboloid(const Eigen::Vector3d& point,
                                                  std::span<const Eigen::Vector3d> candidates,
                                                  double radius_mm) {
  // Weighted covariance of the neighbours (2.1). Units of the radius keep all sums well scaled.
  const Neighbours neighbours(point, candidates, radius_mm);
  if (neighbours.count() < kParaboloid.least_samples) return std::nullopt;
  const Covariance c = SumCovariance(neighbours);
  const Eigen::Vector3d mean = Eigen::Vector3d(c.x, c.y, c.z) / c.w;
  Eigen::Matrix3d covariance;
  covariance << c.xx, c.xy, c.xz, c.xy, c.yy, c.yz, c.xz, c.yz, c.zz;
  covariance = covariance / c.w - mean * mean.transpose();
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen;
  eigen.computeDirect(covariance);
  const Eigen::Vector3d spread = eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  if (!(spread[1] > kParaboloid.least_aspect * spread[2])) return std::nullopt;
  const Eigen::Vector3d nu = eigen.eigenvectors().col(0);
  const Eigen::Vector3d ex = eigen.eigenvectors().col(2);
  const Eigen::Vector3d ey = nu.cross(ex);

  // z = a x^2 + b y^2 + c xy + d x + e y + f in units of the radius.
  Eigen::Matrix3d axes;
  axes << ex, ey, nu;
  const Moments m = SumMoments(neighbours, axes);
  Matrix6d normal_matrix;
  normal_matrix << m.m40, m.m22, m.m31, m.m30, m.m21, m.m20,  //
      m.m22, m.m04, m.m13, m.m12, m.m03, m.m02,               //
      m.m31, m.m13, m.m22, m.m21, m.m12, m.m11,               //
      m.m30, m.m12, m.m21, m.m20, m.m11, m.m10,               //
      m.m21, m.m03, m.m12, m.m11, m.m02, m.m01,               //
      m.m20, m.m02, m.m11, m.m10, m.m01, m.m00;
  Vector6d right;
  right << m.z20, m.z02, m.z11, m.z10, m.z01, m.z00;
  Vector6d k;
  // Two laser stripes leave the curvature across them open; a third one settles it.
  if (!SolveWellConditioned(normal_matrix, right, kParaboloid.least_condition, k)) {
    return std::nullopt;
  }

  LocalParaboloid fit;
  fit.samples = neighbours.count();
  fit.rms_mm = radius_mm * std::sqrt(std::max(0.0, m.zz - k.dot(right)) / m.m00);
  const double d = k[3];
  const double e = k[4];
  fit.foot_mm = point + radius_mm * k[5] * nu;
  fit.normal = (nu - d * ex - e * ey).normalized();

  SetCurvature(k, axes, radius_mm, fit);
  return fit;
}

}  // namespace bendloop::pipeline
