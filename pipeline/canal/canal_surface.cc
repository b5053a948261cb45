// SPDX-License-Identifier: Apache-2.0
#include "pipeline/canal/canal_surface.h"

#include <Eigen/Dense>
#include <Eigen/Sparse>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>

namespace bendloop::pipeline {
namespace {

// How curves are fitted to nodes, and feet of points found on them. By trial.
struct SurfaceSettings {
  // Newton's steps to a foot at most.
  int most_newton = 8;
  // [of the nodes' weight for each control point] Of third differences: keeps control points that
  // no node speaks for in line.
  double smooth = 1e-4;
};
constexpr SurfaceSettings kSurface;

Eigen::Vector4d Weights(double u, int derivative) {
  const double v = 1 - u;
  switch (derivative) {
    case 0:
      return Eigen::Vector4d(v * v * v, 3 * u * u * u - 6 * u * u + 4,
                             -3 * u * u * u + 3 * u * u + 3 * u + 1, u * u * u) /
             6.0;
    case 1:
      return Eigen::Vector4d(-v * v, 3 * u * u - 4 * u, -3 * u * u + 2 * u + 1, u * u) / 2.0;
    default:
      return {v, 3 * u - 2, 1 - 3 * u, u};
  }
}

int SpanOf(double t, int spans) { return std::clamp(static_cast<int>(t), 0, spans - 1); }

}  // namespace

int CanalSurface::Span(double t, int spans, Eigen::Vector4d& weights) {
  const int span = SpanOf(t, spans);
  weights = Weights(t - span, 0);
  return span;
}

Eigen::Vector4d CanalSurface::Blend(double t, int derivative) const {
  const int span = SpanOf(t, spans());
  const Eigen::Vector4d w = Weights(t - span, derivative);
  const auto first = static_cast<std::size_t>(span);
  return w[0] * control_[first] + w[1] * control_[first + 1] + w[2] * control_[first + 2] +
         w[3] * control_[first + 3];
}

CanalSurface CanalSurface::Through(std::span<const Eigen::Vector4d> points, int spans) {
  std::vector<double> along(points.size(), 0.0);
  for (std::size_t i = 1; i < points.size(); ++i) {
    along[i] = along[i - 1] + (points[i] - points[i - 1]).head<3>().norm();
  }
  const int count = spans + 3;
  std::vector<Eigen::Triplet<double>> entries;
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(count, 4);
  for (std::size_t i = 0; i < points.size(); ++i) {
    Eigen::Vector4d w;
    const int first = Span(along[i] / along.back() * spans, spans, w);
    for (int a = 0; a < 4; ++a) {
      right.row(first + a) += w[a] * points[i].transpose();
      for (int b = 0; b < 4; ++b) entries.emplace_back(first + a, first + b, w[a] * w[b]);
    }
  }
  const Eigen::Vector4d third(-1, 3, -3, 1);
  const double smooth =
      std::max(kSurface.smooth * static_cast<double>(points.size()) / count, 1e-9);
  for (int i = 0; i + 3 < count; ++i) {
    for (int a = 0; a < 4; ++a) {
      for (int b = 0; b < 4; ++b) entries.emplace_back(i + a, i + b, smooth * third[a] * third[b]);
    }
  }
  Eigen::SparseMatrix<double> normal(count, count);
  normal.setFromTriplets(entries.begin(), entries.end());
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> ldlt(normal);
  const Eigen::MatrixXd solution = ldlt.solve(right);
  std::vector<Eigen::Vector4d> control(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) {
    control[static_cast<std::size_t>(i)] = solution.row(i).transpose();
  }
  return CanalSurface(std::move(control));
}

CanalFoot CanalSurface::FootNear(const Eigen::Vector3d& point, double guess) const {
  CanalFoot foot;
  double t = std::clamp(guess, 0.0, static_cast<double>(spans()));
  for (int i = 0; i < kSurface.most_newton; ++i) {
    const Eigen::Vector4d c = At(t);
    const Eigen::Vector4d d1 = DerivativeAt(t);
    const Eigen::Vector4d d2 = SecondAt(t);
    const Eigen::Vector3d v = c.head<3>() - point;
    const double rho = std::max(v.norm(), 1e-12);
    const Eigen::Vector3d e = v / rho;
    const double along = e.dot(d1.head<3>());
    const double slope = along - d1[3];
    const double across2 = d1.head<3>().squaredNorm() - along * along;
    double curvature = e.dot(d2.head<3>()) + across2 / rho - d2[3];
    // On the far side of the centre of curvature Newton would run to a maximum.
    curvature = std::max(curvature, 0.1 * d1.head<3>().squaredNorm() / rho);
    const double step = std::clamp(-slope / curvature, -0.7, 0.7);
    const double next = std::clamp(t + step, 0.0, static_cast<double>(spans()));
    foot.beyond = next != t + step;
    const double moved = std::abs(next - t);
    t = next;
    if (moved < 1e-7) break;
  }
  const Eigen::Vector4d c = At(t);
  foot.t = t;
  foot.distance_mm = (point - c.head<3>()).norm() - c[3];
  return foot;
}

std::vector<double> CanalSurface::ArcLengths(int steps) const {
  std::vector<double> along(static_cast<std::size_t>(steps) + 1, 0.0);
  const double h = static_cast<double>(spans()) / steps;
  for (int i = 1; i <= steps; ++i) {
    // Simpson's rule on the speed.
    const double a = (i - 1) * h;
    along[static_cast<std::size_t>(i)] =
        along[static_cast<std::size_t>(i) - 1] +
        h / 6 *
            (DerivativeAt(a).head<3>().norm() + 4 * DerivativeAt(a + 0.5 * h).head<3>().norm() +
             DerivativeAt(a + h).head<3>().norm());
  }
  return along;
}

double CanalSurface::MaxCurvature(double from, double to) const {
  double most = 0;
  const int steps = 8 * spans();
  for (int i = 0; i <= steps; ++i) {
    const double t = from + (to - from) * i / steps;
    const Eigen::Vector3d d1 = DerivativeAt(t).head<3>();
    const Eigen::Vector3d d2 = SecondAt(t).head<3>();
    most = std::max(most, d1.cross(d2).norm() / std::max(std::pow(d1.norm(), 3), 1e-12));
  }
  return most;
}

}  // namespace bendloop::pipeline
