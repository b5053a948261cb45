// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/cylinder_fit.h"

#include <Eigen/Dense>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <vector>

#include "pipeline/math/circle_sectors.h"
#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

// When samples do not tell a cylinder.
struct CylinderLimits {
  // Five numbers from fewer follow the noise (by trial).
  std::size_t least_inliers = 10;
  // [of the largest pivot] An unknown with less is not told by the samples: half of the digits of a
  // double are lost on it.
  double least_pivot = 1e-8;
};
constexpr CylinderLimits kLimits;

using Vector5d = Eigen::Matrix<double, 5, 1>;
using Matrix5d = Eigen::Matrix<double, 5, 5>;
using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 5, 5>;

// Candidates relative to the first guess, as arrays; filled up with points far away to whole
// registers.
class Candidates {
 public:
  Candidates(const Eigen::Vector3d& origin, std::span<const Eigen::Vector3d> points, double far)
      : size_((points.size() + 3) / 4 * 4), values_(6 * size_, far) {
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Eigen::Vector3d v = points[i] - origin;
      values_[i] = v.x();
      values_[size_ + i] = v.y();
      values_[2 * size_ + i] = v.z();
    }
  }
  std::size_t size() const { return size_; }
  const double* lane(std::size_t i) const { return values_.data() + i * size_; }
  // Outward direction across the axis, and weight, as of the last sums.
  double* out(std::size_t i) { return values_.data() + (3 + i) * size_; }

 private:
  std::size_t size_;
  std::vector<double> values_;
};

struct Cylinder {
  std::array<double, 3> point, axis, e1, e2;
  double radius, inverse_support2, inverse_cut, scale;
};

// Sums over the rows (gx, gy, t gx, t gy, 1): the number counts the factors t.
struct CylinderSums {
  double xx0 = 0, xx1 = 0, xx2 = 0, xy0 = 0, xy1 = 0, xy2 = 0, yy0 = 0, yy1 = 0, yy2 = 0;
  double x0 = 0, x1 = 0, y0 = 0, y1 = 0;
  double dx0 = 0, dx1 = 0, dy0 = 0, dy1 = 0, d0 = 0;
  double weight = 0, d2 = 0, t1 = 0, t2 = 0;
  double inliers = 0;
};

BENDLOOP_LOOP CylinderSums SumCylinderBody(const Cylinder& c, Candidates& candidates) {
  const double *px = candidates.lane(0), *py = candidates.lane(1), *pz = candidates.lane(2);
  double *out_x = candidates.out(0), *out_y = candidates.out(1), *out_w = candidates.out(2);
  double xx0 = 0, xx1 = 0, xx2 = 0, xy0 = 0, xy1 = 0, xy2 = 0, yy0 = 0, yy1 = 0, yy2 = 0;
  double x0 = 0, x1 = 0, y0 = 0, y1 = 0;
  double dx0 = 0, dx1 = 0, dy0 = 0, dy1 = 0, d0 = 0;
  double weight = 0, d2 = 0, t1 = 0, t2 = 0, inliers = 0;
  const std::size_t size = candidates.size();
#pragma omp simd reduction(+ : xx0, xx1, xx2, xy0, xy1, xy2, yy0, yy1, yy2, x0, x1, y0, y1, dx0, \
                               dx1, dy0, dy1, d0, weight, d2, t1, t2, inliers)
  for (std::size_t i = 0; i < size; ++i) {
    const double vx = px[i] - c.point[0];
    const double vy = py[i] - c.point[1];
    const double vz = pz[i] - c.point[2];
    const double near = 1.0 - (vx * vx + vy * vy + vz * vz) * c.inverse_support2;
    const double t = (vx * c.axis[0] + vy * c.axis[1] + vz * c.axis[2]) * c.scale;
    const double x = vx * c.e1[0] + vy * c.e1[1] + vz * c.e1[2];
    const double y = vx * c.e2[0] + vy * c.e2[1] + vz * c.e2[2];
    const double rho = std::sqrt(x * x + y * y);
    const double d = rho - c.radius;
    const double off = d * c.inverse_cut;
    const double tukey = 1.0 - off * off;
    const double both = near > 0 && tukey > 0 && rho > 0 ? near * tukey : 0.0;
    const double w = both * both;
    const double inverse = 1.0 / (rho > 0 ? rho : 1.0);
    const double gx = x * inverse;
    const double gy = y * inverse;
    const double wgx = w * gx, wgy = w * gy;
    const double wxx = wgx * gx, wxy = wgx * gy, wyy = wgy * gy;
    const double tt = t * t;
    xx0 += wxx, xx1 += wxx * t, xx2 += wxx * tt;
    xy0 += wxy, xy1 += wxy * t, xy2 += wxy * tt;
    yy0 += wyy, yy1 += wyy * t, yy2 += wyy * tt;
    x0 += wgx, x1 += wgx * t;
    y0 += wgy, y1 += wgy * t;
    dx0 += d * wgx, dx1 += d * wgx * t;
    dy0 += d * wgy, dy1 += d * wgy * t;
    d0 += w * d;
    weight += w;
    d2 += w * d * d;
    t1 += w * t;
    t2 += w * tt;
    inliers += w > 0 ? 1.0 : 0.0;
    out_x[i] = gx;
    out_y[i] = gy;
    out_w[i] = w;
  }
  return {xx0, xx1, xx2, xy0, xy1, xy2, yy0,    yy1, yy2, x0, x1,     y0,
          y1,  dx0, dx1, dy0, dy1, d0,  weight, d2,  t1,  t2, inliers};
}
BENDLOOP_MULTIVERSION(CylinderSums, SumCylinder, (const Cylinder& c, Candidates& candidates),
                      (c, candidates))

// Part of the circumference that has inliers.
double AngularCoverage(Candidates& candidates) {
  constexpr unsigned kSectors = 32;  // as many as there are bits
  std::uint32_t sectors = 0;
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    if (candidates.out(2)[i] > 0) {
      sectors |= 1u << AzimuthSector<kSectors>(candidates.out(0)[i], candidates.out(1)[i]);
    }
  }
  return static_cast<double>(std::popcount(sectors)) / kSectors;
}

// Of the unknowns shift along e1 and e2, tilt along them, radius.
Matrix5d NormalMatrix(const CylinderSums& s) {
  Matrix5d normal_matrix;
  normal_matrix << s.xx0, s.xy0, s.xx1, s.xy1, s.x0,  //
      s.xy0, s.yy0, s.xy1, s.yy1, s.y0,               //
      s.xx1, s.xy1, s.xx2, s.xy2, s.x1,               //
      s.xy1, s.yy1, s.xy2, s.yy2, s.y1,               //
      s.x0, s.y0, s.x1, s.y1, s.weight;
  return normal_matrix;
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

  Candidates points(point, candidates, 1e3 * options.support_mm);
  CylinderSums s;
  const auto array = [](const Eigen::Vector3d& v) { return std::array{v.x(), v.y(), v.z()}; };

  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    const Eigen::Vector3d e1 = fit.axis.unitOrthogonal();
    const Eigen::Vector3d e2 = fit.axis.cross(e1);
    // The first steps look wider, so that a guess off by a part of the radius finds the surface.
    const double cut = options.inlier_mm * (iteration == 0 ? 3.0 : iteration == 1 ? 2.0 : 1.0);
    s = SumCylinder({array(fit.point_mm - point), array(fit.axis), array(e1), array(e2),
                     fit.radius_mm, 1.0 / support2, 1.0 / cut, scale},
                    points);
    fit.inliers = static_cast<std::size_t>(s.inliers);
    if (fit.inliers < kLimits.least_inliers) return std::nullopt;

    Vector5d step = Vector5d::Zero();
    const int unknowns = options.free_radius ? 5 : 4;
    const Matrix5d normal_matrix = NormalMatrix(s);
    Vector5d right;
    right << s.dx0, s.dy0, s.dx1, s.dy1, s.d0;
    const SmallMatrix lower = normal_matrix.topLeftCorner(unknowns, unknowns);
    const Eigen::LDLT<SmallMatrix> ldlt(lower);
    if (!(ldlt.vectorD().minCoeff() > kLimits.least_pivot * ldlt.vectorD().maxCoeff())) {
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
                              options.tolerance * options.radius_mm) {
      break;
    }
  }
  fit.rms_mm = std::sqrt(s.d2 / s.weight);
  const double t_mean = s.t1 / s.weight;
  fit.axial_spread_mm = std::sqrt(std::max(0.0, s.t2 / s.weight - t_mean * t_mean)) / scale;
  fit.angular_coverage = AngularCoverage(points);
  return fit;
}

}  // namespace bendloop::pipeline
