// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/crease.h"

#include <Eigen/Dense>
#include <cmath>

namespace bendloop::pipeline {
namespace {

using Eigen::Vector3d;

// Fewer points are a plane rather than a paraboloid, and still fewer nothing.
constexpr std::size_t kOfParaboloid = 14, kOfPlane = 6;
constexpr int kStepsToCrease = 6;
constexpr double kLeastSine = 0.17;

// z = c . (1, x, y, x^2, x y, y^2) over the points' own plane.
class Side {
 public:
  static std::optional<Side> Through(const std::vector<Vector3d>& points) {
    if (points.size() < kOfPlane) return std::nullopt;
    Side side;
    side.middle_.setZero();
    for (const Vector3d& p : points) side.middle_ += p / static_cast<double>(points.size());
    Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
    for (const Vector3d& p : points) {
      spread += (p - side.middle_) * (p - side.middle_).transpose();
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(spread);
    if (!(eigen.eigenvalues()[1] > 1e-3 * eigen.eigenvalues()[2])) return std::nullopt;
    side.frame_ = eigen.eigenvectors();  // columns: normal, then both directions of the plane
    const Eigen::Index terms = points.size() < kOfParaboloid ? 3 : 6;
    const auto n = static_cast<Eigen::Index>(points.size());
    Eigen::MatrixXd A(n, terms);
    Eigen::VectorXd z(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const Vector3d p = side.Local(points[static_cast<std::size_t>(i)]);
      A.row(i) = Terms(p).head(terms).transpose();
      z[i] = p[0];
    }
    side.c_.setZero();
    side.c_.head(terms) = A.colPivHouseholderQr().solve(z);
    return side;
  }

  double Height(const Vector3d& at) const {
    const Vector3d p = Local(at);
    return p[0] - c_.dot(Terms(p));
  }

  Vector3d Gradient(const Vector3d& at) const {
    const Vector3d p = Local(at);
    return frame_ * Vector3d(1, -c_[1] - 2 * c_[3] * p[1] - c_[4] * p[2],
                             -c_[2] - c_[4] * p[1] - 2 * c_[5] * p[2]);
  }

 private:
  using Vector6d = Eigen::Matrix<double, 6, 1>;
  Vector3d Local(const Vector3d& at) const { return frame_.transpose() * (at - middle_); }
  static Vector6d Terms(const Vector3d& p) {
    Vector6d terms;
    terms << 1, p[1], p[2], p[1] * p[1], p[1] * p[2], p[2] * p[2];
    return terms;
  }

  Vector3d middle_;
  Eigen::Matrix3d frame_;
  Vector6d c_;
};

}  // namespace

std::optional<Vector3d> CreasePlace(const Vector3d& near_mm,
                                    const std::vector<Vector3d>& one_side_mm,
                                    const std::vector<Vector3d>& other_side_mm, double reach_mm) {
  const auto one = Side::Through(one_side_mm), other = Side::Through(other_side_mm);
  if (!one || !other) return std::nullopt;
  Vector3d place = near_mm;
  for (int step = 0; step < kStepsToCrease; ++step) {
    const Vector3d a = one->Gradient(place), b = other->Gradient(place);
    if (a.cross(b).norm() < kLeastSine * a.norm() * b.norm()) return std::nullopt;
    // The least move onto both.
    Eigen::Matrix<double, 2, 3> J;
    J << a.transpose(), b.transpose();
    const Eigen::Matrix2d JJ = J * J.transpose();
    const Eigen::Vector2d height(one->Height(place), other->Height(place));
    place -= J.transpose() * JJ.inverse() * height;
    if (!((place - near_mm).norm() <= reach_mm)) return std::nullopt;
  }
  return place;
}

}  // namespace bendloop::pipeline
