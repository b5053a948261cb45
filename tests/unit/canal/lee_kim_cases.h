// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

// The surfaces of Lee & Kim 2004, section 4: B-spline spine and radius function, sampled at random
// parameters, each sample moved along the normal by a uniform perturbation.
namespace bendloop::tests {

// A B-spline curve of any dimension: control points, knots, degree.
template <int N>
struct BSpline {
  using Point = Eigen::Matrix<double, N, 1>;
  std::vector<Point> control;
  std::vector<double> knots;
  int degree;

  double last() const { return knots.back(); }
  // De Boor's recursion.
  Point operator()(double t) const {
    std::size_t k = static_cast<std::size_t>(degree);
    while (k + 1 < control.size() && t >= knots[k + 1]) ++k;
    std::vector<Point> d;
    for (int j = 0; j <= degree; ++j) {
      d.push_back(control[k - static_cast<std::size_t>(degree) + static_cast<std::size_t>(j)]);
    }
    for (int r = 1; r <= degree; ++r) {
      for (int j = degree; j >= r; --j) {
        const std::size_t i = static_cast<std::size_t>(j) + k - static_cast<std::size_t>(degree);
        const double a =
            (t - knots[i]) / (knots[i + 1 + static_cast<std::size_t>(degree - r)] - knots[i]);
        d[static_cast<std::size_t>(j)] =
            (1 - a) * d[static_cast<std::size_t>(j) - 1] + a * d[static_cast<std::size_t>(j)];
      }
    }
    return d[static_cast<std::size_t>(degree)];
  }
};

struct LeeKimCase {
  BSpline<3> spine;
  BSpline<1> radius;
  double perturbation;

  Eigen::Vector3d At(double part) const { return spine(part * spine.last()); }
  double RadiusAt(double part) const { return radius(part * radius.last())[0]; }
};

inline BSpline<1> RadiusFunction(const std::vector<double>& values, std::vector<double> knots,
                                 int degree) {
  BSpline<1> function{{}, std::move(knots), degree};
  for (const double value : values) function.control.push_back(Eigen::Matrix<double, 1, 1>(value));
  return function;
}

inline BSpline<1> ConstantRadius(double radius) {
  return RadiusFunction({radius, radius}, {0, 0, 1, 1}, 1);
}

inline BSpline<3> Table1() {
  return {{{-3.000, 6.660, 0.000},
           {-0.337, 5.660, -4.660},
           {0.410, 0.430, -8.052},
           {-2.037, -7.906, -3.354},
           {1.813, -6.807, -0.175},
           {6.760, -3.150, 0.000}},
          {0, 0, 0, 0, 1, 2, 3, 3, 3, 3},
          3};
}

// Figure 9.
inline LeeKimCase Table1Pipe() { return {Table1(), ConstantRadius(1), 0.1}; }

// Figure 15. The radius is printed as 3; 0.3 is what the figure and the result (0.298778) show.
inline LeeKimCase Table2Pipe() {
  return {{{{0.000, 0.000, 0.000},
            {2.773, -0.234, 0.159},
            {3.091, 0.058, -0.043},
            {3.086, 2.917, -0.365},
            {2.939, 3.054, 0.247},
            {0.066, 3.159, -0.292},
            {-0.279, 2.959, 0.377},
            {0.411, 3.108, 2.569},
            {-0.045, 2.942, 2.928},
            {0.000, 0.000, 3.000}},
           {0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 7, 7, 7},
           3},
          ConstantRadius(0.3),
          0.05};
}

// Figure 14.
inline LeeKimCase Table1Canal() {
  return {Table1(), RadiusFunction({2, 1.5, 1, 1.5, 2.5, 2}, {0, 0, 0, 1, 2, 3, 4, 4, 4}, 2), 0.05};
}

// Figure 16.
inline LeeKimCase Table3Canal() {
  return {{{{-4.000, 4.000, 0.000},
            {-0.478, 4.547, 0.000},
            {3.335, 2.618, 0.000},
            {1.428, -1.214, 0.000},
            {-3.543, -1.614, 0.000},
            {-4.257, -4.700, 0.000}},
           {0, 0, 0, 0, 1, 2, 3, 3, 3, 3},
           3},
          RadiusFunction({1.9999, 1.6666, 1.103463, 1.037336, 1.833333, 2.5},
                         {0, 0, 0, 0, 1, 2, 3, 3, 3, 3}, 3),
          0.05};
}

inline std::vector<Eigen::Vector3d> Sample(const LeeKimCase& surface, std::size_t count,
                                           std::mt19937_64& random) {
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<Eigen::Vector3d> points;
  while (points.size() < count) {
    const double part = unit(random);
    constexpr double kStep = 1e-4;
    const double low = std::max(0.0, part - kStep);
    const double high = std::min(1.0, part + kStep);
    const Eigen::Vector3d velocity = (surface.At(high) - surface.At(low)) / (high - low);
    const Eigen::Vector3d tangent = velocity.normalized();
    // The circle in which the sphere touches the envelope: behind the centre where the radius
    // grows.
    const double slope =
        (surface.RadiusAt(high) - surface.RadiusAt(low)) / (high - low) / velocity.norm();
    const double phi = 2 * std::numbers::pi * unit(random);
    const Eigen::Vector3d e1 = tangent.unitOrthogonal();
    const Eigen::Vector3d e2 = tangent.cross(e1);
    const Eigen::Vector3d normal =
        -slope * tangent + std::sqrt(1 - slope * slope) * (std::cos(phi) * e1 + std::sin(phi) * e2);
    const double off = surface.perturbation * (2 * unit(random) - 1);
    points.push_back(surface.At(part) + (surface.RadiusAt(part) + off) * normal);
  }
  return points;
}

// Closest point of the true spine: (distance, parameter as a part of the whole).
inline std::pair<double, double> Closest(const LeeKimCase& surface, const Eigen::Vector3d& point) {
  double best = std::numeric_limits<double>::infinity();
  double at = 0;
  constexpr int kSteps = 2000;
  for (int i = 0; i <= kSteps; ++i) {
    const double part = static_cast<double>(i) / kSteps;
    const double d = (surface.At(part) - point).norm();
    if (d < best) {
      best = d;
      at = part;
    }
  }
  return {best, at};
}

}  // namespace bendloop::tests
