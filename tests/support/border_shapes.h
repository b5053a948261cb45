// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Dense>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <vector>

#include "pipeline/features/border_fit.h"

// Borders whose exact form is known. Lengths in mm.
namespace bendloop::tests {

// A closed border by its place at t from 0 to 1.
using BorderShape = std::function<Eigen::Vector3d(double)>;

// Oblique plane cut of a cylinder about z: an ellipse. `tilt`: of the plane's normal off the axis,
// [rad].
inline BorderShape ObliqueCut(double radius_mm, double tilt) {
  return [=](double t) {
    const double a = 2 * std::numbers::pi * t;
    return Eigen::Vector3d(radius_mm * std::cos(a), radius_mm * std::sin(a),
                           radius_mm * std::cos(a) * std::tan(tilt));
  };
}

// Where a drill of `hole_radius_mm` meets the wall of a tube about z: a curve of fourth degree. The
// drill's axis passes `beside_mm` beside the tube's and leans `lean` [rad] from square.
inline BorderShape DrilledHole(double radius_mm, double hole_radius_mm, double beside_mm,
                               double lean) {
  return [=](double t) {
    const double a = 2 * std::numbers::pi * t;
    const Eigen::Vector3d along(std::cos(lean), 0, std::sin(lean)), side(0, 1, 0);
    const Eigen::Vector3d up = along.cross(side);
    const Eigen::Vector3d line =
        beside_mm * side + hole_radius_mm * (std::cos(a) * side + std::sin(a) * up);
    // The outer crossing of line + s along with the cylinder.
    const double A = along.head<2>().squaredNorm(), B = line.head<2>().dot(along.head<2>());
    const double C = line.head<2>().squaredNorm() - radius_mm * radius_mm;
    return Eigen::Vector3d(line + (-B + std::sqrt(B * B - A * C)) / A * along);
  };
}

// A slot with round ends, developed onto a tube about z: straight sides and half circles, G1 only.
inline BorderShape RoundSlot(double radius_mm, double length_mm, double width_mm) {
  return [=](double t) {
    const double r = 0.5 * width_mm, straight = length_mm - width_mm;
    const double half = straight + std::numbers::pi * r;
    double s = t * 2 * half;
    const double sign = s < half ? 1 : -1;
    if (s >= half) s -= half;
    Eigen::Vector2d flat(s - 0.5 * straight, r);
    if (s > straight) {
      const double a = (s - straight) / r;
      flat = {0.5 * straight + r * std::sin(a), r * std::cos(a)};
    }
    flat *= sign;
    return Eigen::Vector3d(radius_mm * std::cos(flat.y() / radius_mm),
                           radius_mm * std::sin(flat.y() / radius_mm), flat.x());
  };
}

// The same with square ends: four corners.
inline BorderShape SquareSlot(double radius_mm, double length_mm, double width_mm) {
  return [=](double t) {
    const double half = length_mm + width_mm;
    double s = t * 2 * half;
    const double sign = s < half ? 1 : -1;
    if (s >= half) s -= half;
    Eigen::Vector2d flat(s - 0.5 * length_mm, 0.5 * width_mm);
    if (s > length_mm) flat = {0.5 * length_mm, 0.5 * width_mm - (s - length_mm)};
    flat *= sign;
    return Eigen::Vector3d(radius_mm * std::cos(flat.y() / radius_mm),
                           radius_mm * std::sin(flat.y() / radius_mm), flat.x());
  };
}

// Points of it in order, each off by `noise_mm` in every direction. `start`: where it begins.
inline pipeline::OrderedBorder SampleBorder(const BorderShape& shape, std::size_t points,
                                            double noise_mm, unsigned seed, double start = 0.0) {
  pipeline::OrderedBorder border;
  border.closed = true;
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(0, 1);
  for (std::size_t i = 0; i < points; ++i) {
    const double t = start + static_cast<double>(i) / static_cast<double>(points);
    Eigen::Vector3d place = shape(t - std::floor(t));
    for (double& x : place) x += noise_mm * normal(random);
    border.points_mm.push_back(place);
  }
  return border;
}

// Root mean square of the distances of the true border from a curve.
inline double CurveErrorMm(const pipeline::RationalBezier& curve, const BorderShape& shape) {
  constexpr int kPlaces = 400;
  double sum = 0;
  for (int i = 0; i < kPlaces; ++i) {
    const double distance_mm = curve.NearestTo(shape((i + 0.5) / kPlaces)).distance_mm;
    sum += distance_mm * distance_mm;
  }
  return std::sqrt(sum / kPlaces);
}

}  // namespace bendloop::tests
