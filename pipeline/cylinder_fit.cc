// SPDX-License-Identifier: Apache-2.0
#include "pipeline/cylinder_fit.h"

#include <Eigen/Dense>
#include <bit>
#include <cmath>
#include <cstdint>

namespace bendloop::pipeline {
namespace {

constexpr std::size_t kMinInliers = 10;
constexpr int kSectors = 32;
constexpr double kConverged = 1e-6;  // of the radius

using Vector5d = Eigen::Matrix<double, 5, 1>;
using Matrix5d = Eigen::Matrix<double, 5, 5>;
using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 5, 5>;

// Which of the kSectors parts of the turn the unit vector (x, y) points into: on the square around
// the circle, which is close enough to equal parts and needs no arc tangent.
unsigned Sector(double x, double y) {
  const double s = y / (std::abs(x) + std::abs(y));   // -1..1 over half a turn
  const double quarter = x >= 0 ? 1.0 + s : 3.0 - s;  // 0..4 over the turn
  return static_cast<unsigned>(quarter * (kSectors / 4)) % kSectors;
}

}  // namespace

std::optional<LocalCylinder> FitCylinder(const Eigen::Vector3d& point, const Eigen::Vector3d& axis,
                                         std::span<const Eigen::Vector3d> candidates,
                                         const CylinderFitOptions& options) {
  LocalCylinder fit;
  fit.point_mm = point;
  fit.axis = axis;
  fit.radius_mm = options.radius_mm;
  const double support2 = options.support_mm * options.support_mm;
  // Scaling the direction's columns by the support keeps the normal equations balanced.
  const double scale = 1.0 / options.support_mm;

  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    const Eigen::Vector3d e1 = fit.axis.unitOrthogonal();
    const Eigen::Vector3d e2 = fit.axis.cross(e1);
    // The first steps look wider, so that a guess off by a part of the radius finds the surface.
    const double cut = options.inlier_mm * (iteration == 0 ? 3.0 : iteration == 1 ? 2.0 : 1.0);
    // Sums over the rows (gx, gy, t gx, t gy, 1): the number counts the factors t.
    double xx0 = 0, xx1 = 0, xx2 = 0, xy0 = 0, xy1 = 0, xy2 = 0, yy0 = 0, yy1 = 0, yy2 = 0;
    double x0 = 0, x1 = 0, y0 = 0, y1 = 0;
    double dx0 = 0, dx1 = 0, dy0 = 0, dy1 = 0, d0 = 0;
    double sum_weight = 0, sum_d2 = 0, sum_a = 0, sum_a2 = 0;
    std::uint32_t sectors = 0;
    fit.inliers = 0;
    for (const Eigen::Vector3d& candidate : candidates) {
      const Eigen::Vector3d v = candidate - fit.point_mm;
      const double near = 1.0 - v.squaredNorm() / support2;
      if (near <= 0) continue;
      const double a = v.dot(fit.axis);
      const double x = v.dot(e1);
      const double y = v.dot(e2);
      const double rho = std::sqrt(x * x + y * y);
      const double d = rho - fit.radius_mm;
      if (std::abs(d) >= cut || rho <= 0) continue;
      const double tukey = 1.0 - (d / cut) * (d / cut);
      const double w = near * near * tukey * tukey;
      const double gx = x / rho;
      const double gy = y / rho;
      const double t = a * scale;
      const double wgx = w * gx, wgy = w * gy;
      const double wxx = wgx * gx, wxy = wgx * gy, wyy = wgy * gy;
      xx0 += wxx, xx1 += wxx * t, xx2 += wxx * t * t;
      xy0 += wxy, xy1 += wxy * t, xy2 += wxy * t * t;
      yy0 += wyy, yy1 += wyy * t, yy2 += wyy * t * t;
      x0 += wgx, x1 += wgx * t;
      y0 += wgy, y1 += wgy * t;
      dx0 += d * wgx, dx1 += d * wgx * t;
      dy0 += d * wgy, dy1 += d * wgy * t;
      d0 += w * d;
      sum_weight += w;
      sum_d2 += w * d * d;
      sum_a += w * a;
      sum_a2 += w * a * a;
      ++fit.inliers;
      sectors |= 1u << Sector(gx, gy);
    }
    if (fit.inliers < kMinInliers) return std::nullopt;
    fit.rms_mm = std::sqrt(sum_d2 / sum_weight);
    fit.axial_spread_mm =
        std::sqrt(std::max(0.0, sum_a2 / sum_weight - std::pow(sum_a / sum_weight, 2)));
    fit.angular_coverage = static_cast<double>(std::popcount(sectors)) / kSectors;

    Vector5d step = Vector5d::Zero();
    const int unknowns = options.free_radius ? 5 : 4;
    Matrix5d normal_matrix;
    normal_matrix << xx0, xy0, xx1, xy1, x0,  //
        xy0, yy0, xy1, yy1, y0,               //
        xx1, xy1, xx2, xy2, x1,               //
        xy1, yy1, xy2, yy2, y1,               //
        x0, y0, x1, y1, sum_weight;
    Vector5d right;
    right << dx0, dy0, dx1, dy1, d0;
    const SmallMatrix lower = normal_matrix.topLeftCorner(unknowns, unknowns);
    const Eigen::LDLT<SmallMatrix> ldlt(lower);
    // Pivots of exactly nothing pass the condition's estimate: it skips them.
    if (ldlt.info() != Eigen::Success || !(ldlt.vectorD().minCoeff() > 0) ||
        !(ldlt.rcond() > 1e-8)) {
      return std::nullopt;
    }
    step.head(unknowns) = ldlt.solve(right.head(unknowns));
    if (!step.allFinite()) return std::nullopt;
    // A step of more than half a radius or half a right angle is the model breaking down.
    const Eigen::Vector3d shift = step[0] * e1 + step[1] * e2;
    const Eigen::Vector3d tilt = scale * (step[2] * e1 + step[3] * e2);
    if (shift.norm() > options.radius_mm || tilt.norm() > 1.0) return std::nullopt;
    fit.point_mm += shift;
    fit.axis = (fit.axis + tilt).normalized();
    fit.radius_mm += step[4];
    if (!(fit.radius_mm > 0)) return std::nullopt;
    // Step (iii): back to the foot of the first guess on the axis that now is.
    fit.point_mm += (point - fit.point_mm).dot(fit.axis) * fit.axis;
    if (iteration >= 2 && shift.norm() + options.support_mm * tilt.norm() + std::abs(step[4]) <
                              kConverged * options.radius_mm) {
      break;
    }
  }
  return fit;
}

}  // namespace bendloop::pipeline
