// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/free_surface.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

namespace bendloop::host {
namespace {

using Eigen::Vector3d;

// Fewer samples than this prove nothing.
constexpr std::size_t kFewestSamples = 12;
// Normals this near to a plane (sum of squares of their sines over the count): of a cylinder.
constexpr double kFlatNormals = 1e-10;

Vector3d AnyAcross(const Vector3d& d) { return d.unitOrthogonal(); }

struct Circle {
  Eigen::Vector2d centre;
  double radius = 0;
};

// Least squares of x^2 + y^2 = 2 a x + 2 b y + c.
std::optional<Circle> FitCircle(const std::vector<Eigen::Vector2d>& points) {
  Eigen::MatrixX3d a(points.size(), 3);
  Eigen::VectorXd b(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto row = Eigen::Index(i);
    a.row(row) << 2 * points[i].x(), 2 * points[i].y(), 1;
    b(row) = points[i].squaredNorm();
  }
  const Vector3d s = a.colPivHouseholderQr().solve(b);
  const double square = s.z() + s.head<2>().squaredNorm();
  if (!(square > 0)) return std::nullopt;
  return Circle{s.head<2>(), std::sqrt(square)};
}

// The ends of the angles that a face covers: all but the widest gap. A full turn: gap no wider than
// the samples are apart.
std::pair<double, double> CoveredAngles(std::vector<double> angles) {
  std::sort(angles.begin(), angles.end());
  double gap = 2 * std::numbers::pi - (angles.back() - angles.front());
  std::size_t after = 0;
  for (std::size_t i = 1; i < angles.size(); ++i) {
    if (angles[i] - angles[i - 1] > gap) {
      gap = angles[i] - angles[i - 1];
      after = i;
    }
  }
  constexpr double kStep = 16 * std::numbers::pi / 180;  // bendloop-cad's grid: 15 degrees
  if (gap < kStep) return {0, 2 * std::numbers::pi};
  const double start = angles[after];
  return {start, start + 2 * std::numbers::pi - gap};
}

double ShareConcave(const SurfacePatch& patch, const auto& inside_of) {
  double concave = 0;
  for (const OrientedPoint& s : patch.samples) {
    if (s.normal.dot(s.point - inside_of(s.point)) < 0) ++concave;
  }
  return concave / double(patch.samples.size());
}

}  // namespace

bool BecomeCylinder(SurfacePatch& patch, const Vector3d& axis, const Vector3d& mean,
                    SurfaceLimit limit) {
  const Vector3d x = AnyAcross(axis), y = axis.cross(x);
  std::vector<Eigen::Vector2d> flat;
  for (const OrientedPoint& s : patch.samples) {
    flat.emplace_back((s.point - mean).dot(x), (s.point - mean).dot(y));
  }
  const auto circle = FitCircle(flat);
  if (!circle) return false;
  std::vector<double> angles;
  double low = INFINITY, high = -INFINITY, off = 0;
  for (std::size_t i = 0; i < flat.size(); ++i) {
    const Eigen::Vector2d d = flat[i] - circle->centre;
    off = std::max(off, std::abs(d.norm() - circle->radius));
    if (off > limit(circle->radius)) return false;
    angles.push_back(std::atan2(d.y(), d.x()));
    const double along = (patch.samples[i].point - mean).dot(axis);
    low = std::min(low, along);
    high = std::max(high, along);
  }
  patch.kind = PatchKind::kCylinder;
  patch.off_mm = off;
  patch.origin = mean + circle->centre.x() * x + circle->centre.y() * y;
  patch.axis = axis;
  patch.x = x;
  patch.y = y;
  patch.radius_mm = circle->radius;
  std::tie(patch.u0, patch.u1) = CoveredAngles(std::move(angles));
  patch.v0 = low;
  patch.v1 = high;
  patch.concave = ShareConcave(patch, [&](const Vector3d& p) {
                    return Vector3d(patch.origin + (p - patch.origin).dot(axis) * axis);
                  }) > 0.5;
  return true;
}

bool BecomeTorus(SurfacePatch& patch, const Vector3d& axis, const Vector3d& at,
                 SurfaceLimit limit) {
  std::vector<Eigen::Vector2d> profile;  // distance from the axis, height along it
  for (const OrientedPoint& s : patch.samples) {
    const Vector3d d = s.point - at;
    const double h = d.dot(axis);
    profile.emplace_back((d - h * axis).norm(), h);
  }
  const auto circle = FitCircle(profile);
  if (!circle || circle->centre.x() <= circle->radius) return false;
  const Vector3d centre = at + circle->centre.y() * axis;
  const Vector3d x = AnyAcross(axis), y = axis.cross(x);
  std::vector<double> sweep, around;
  double off = 0;
  for (std::size_t i = 0; i < profile.size(); ++i) {
    const Eigen::Vector2d d = profile[i] - circle->centre;
    off = std::max(off, std::abs(d.norm() - circle->radius));
    if (off > limit(circle->radius)) return false;
    const Vector3d p = patch.samples[i].point - centre;
    sweep.push_back(std::atan2(p.dot(y), p.dot(x)));
    around.push_back(std::atan2(d.y(), d.x()));
  }
  patch.kind = PatchKind::kTorus;
  patch.off_mm = off;
  patch.origin = centre;
  patch.axis = axis;
  patch.x = x;
  patch.y = y;
  patch.radius_mm = circle->radius;
  patch.bend_radius_mm = circle->centre.x();
  std::tie(patch.u0, patch.u1) = CoveredAngles(std::move(sweep));
  std::tie(patch.v0, patch.v1) = CoveredAngles(std::move(around));
  patch.concave = ShareConcave(patch, [&](const Vector3d& p) {
                    const Vector3d d = p - centre, radial = d - d.dot(axis) * axis;
                    return Vector3d(centre + patch.bend_radius_mm * radial.normalized());
                  }) > 0.5;
  return true;
}

SurfaceGuess GuessSurface(const SurfacePatch& patch) {
  SurfaceGuess guess;
  guess.mean = Vector3d::Zero();
  Eigen::Matrix3d normals = Eigen::Matrix3d::Zero();
  for (const OrientedPoint& s : patch.samples) {
    guess.mean += s.point;
    normals += s.normal * s.normal.transpose();
  }
  const double count = double(patch.samples.size());
  guess.mean /= count;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> spread(normals / count);
  guess.across = spread.eigenvalues()(0);
  guess.is_plane = spread.eigenvalues()(1) < kFlatNormals;
  guess.cylinder_axis = spread.eigenvectors().col(0);
  for (const OrientedPoint& s : patch.samples) {
    guess.size_mm = std::max(guess.size_mm, (s.point - guess.mean).norm());
  }
  if (!(guess.size_mm > 0)) guess.is_plane = true;
  if (guess.is_plane) return guess;
  // A line (d, m) meets the normal line (n, p x n) where d (p x n) + m n = 0; scaled to size 1.
  Eigen::Matrix<double, 6, 6> lines = Eigen::Matrix<double, 6, 6>::Zero();
  for (const OrientedPoint& s : patch.samples) {
    Eigen::Matrix<double, 6, 1> line;
    line << ((s.point - guess.mean) / guess.size_mm).cross(s.normal), s.normal;
    lines += line * line.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> solver(lines / count);
  const Vector3d d = solver.eigenvectors().col(0).head<3>();
  const Vector3d m = solver.eigenvectors().col(0).tail<3>();
  if (d.norm() < 1e-6) return guess;
  guess.has_revolution = true;
  guess.revolution_axis = d.normalized();
  guess.on_revolution_axis = guess.mean + guess.size_mm * d.cross(m) / d.squaredNorm();
  return guess;
}

bool IsPlane(const SurfacePatch& patch) {
  return patch.samples.size() >= kFewestSamples && GuessSurface(patch).is_plane;
}

void RecogniseFreeSurface(SurfacePatch& patch) {
  if (patch.kind != PatchKind::kFree || patch.samples.size() < kFewestSamples) return;
  const SurfaceGuess guess = GuessSurface(patch);
  if (guess.is_plane) return;
  const auto exact = [](double) { return kExactSurfaceMm; };
  if (guess.across < kFlatNormals &&
      BecomeCylinder(patch, guess.cylinder_axis, guess.mean, exact)) {
    return;
  }
  if (guess.has_revolution) {
    BecomeTorus(patch, guess.revolution_axis, guess.on_revolution_axis, exact);
  }
}

}  // namespace bendloop::host
