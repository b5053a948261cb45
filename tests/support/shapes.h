// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <random>
#include <tuple>
#include <vector>

#include "hal/pose.h"
#include "hal/spine.h"
#include "pipeline/fit/surface_points.h"
#include "tests/support/synthetic_cloud.h"
#include "tests/support/uniform.h"

// Surfaces with known curvature, and small helpers, for the tests of the stages.
namespace bendloop::tests {

using Random = std::mt19937_64;
using Points = std::vector<Eigen::Vector3d>;

inline constexpr double kPi = std::numbers::pi;
inline constexpr double kDegrees = 180.0 / kPi;

inline Eigen::Vector3d RandomUnit(Random& random) {
  std::normal_distribution<double> normal;
  return Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
}

inline Points Moved(Points points, const hal::Pose& pose) {
  for (Eigen::Vector3d& p : points) p = pose * p;
  return points;
}

// Around the z axis, `length` to both sides of z = 0; the turn from `from` to `to`.
inline Points CylinderPoints(double radius, double length, std::size_t count, Random& random,
                             double noise = 0, double from = 0, double to = 2 * kPi) {
  std::normal_distribution<double> normal(0, noise);
  Points points;
  for (std::size_t i = 0; i < count; ++i) {
    const double phi = Uniform(random, from, to);
    const double r = radius + (noise > 0 ? normal(random) : 0.0);
    points.emplace_back(r * std::cos(phi), r * std::sin(phi), Uniform(random, -length, length));
  }
  return points;
}

// On the plane z = 0, within +-half.
inline Points PlanePoints(double half, std::size_t count, Random& random, double noise = 0) {
  std::normal_distribution<double> normal(0, noise);
  Points points;
  for (std::size_t i = 0; i < count; ++i) {
    points.emplace_back(Uniform(random, -half, half), Uniform(random, -half, half),
                        noise > 0 ? normal(random) : 0.0);
  }
  return points;
}

inline Points SpherePoints(double radius, std::size_t count, Random& random, double noise = 0) {
  std::normal_distribution<double> normal(0, noise);
  Points points;
  for (std::size_t i = 0; i < count; ++i) {
    points.push_back((radius + (noise > 0 ? normal(random) : 0.0)) * RandomUnit(random));
  }
  return points;
}

// Least distance of `point` from the spine, and the tangent there, by dense sampling.
inline std::pair<double, Eigen::Vector3d> NearestOnSpine(
    const Eigen::Vector3d& point, const std::vector<hal::SpineSegment>& segments, double step) {
  double best = std::numeric_limits<double>::infinity();
  Eigen::Vector3d tangent = Eigen::Vector3d::UnitX();
  for (const auto& segment : segments) {
    const int steps = std::max(1, static_cast<int>(std::ceil(segment.length_mm / step)));
    for (int i = 0; i <= steps; ++i) {
      const double along = segment.length_mm * i / steps;
      const Eigen::Vector3d v = point - segment.PointAt(along);
      const Eigen::Vector3d t = segment.TangentAt(along);
      // The part across the tangent, when the foot is between this sample and its neighbours.
      const double d = std::abs(v.dot(t)) <= step ? (v - v.dot(t) * t).norm() : v.norm();
      if (d < best) {
        best = d;
        tangent = t;
      }
    }
  }
  return {best, tangent};
}

// Points sorted into cubes, as the surface fit takes them; with certainties or without.
inline pipeline::OwnedBlocks Blocks(const Points& points, double edge,
                                    const std::vector<float>& certainties = {}) {
  std::map<std::tuple<int, int, int>, std::vector<std::size_t>> cubes;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3i c = (points[i] / edge).array().floor().cast<int>();
    cubes[{c.x(), c.y(), c.z()}].push_back(i);
  }
  const pipeline::PointBlock all{{0, 0, 0}, 0, points, certainties};
  pipeline::OwnedBlocks blocks(points.size(), !certainties.empty());
  for (const auto& [c, held] : cubes) {
    const Eigen::Vector3d low(std::get<0>(c), std::get<1>(c), std::get<2>(c));
    blocks.Begin((low + Eigen::Vector3d::Constant(0.5)) * edge, 0.5 * std::sqrt(3.0) * edge);
    for (const std::size_t i : held) blocks.Add(all, i);
  }
  return blocks;
}

}  // namespace bendloop::tests
