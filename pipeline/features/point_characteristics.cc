// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/point_characteristics.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace bendloop::pipeline {
namespace {

using Eigen::Vector3d;

// Fewer neighbours span no plane.
constexpr std::size_t kLeastNeighbours = 5;
// Points a round of workers.
constexpr std::size_t kOfRound = 1024;

struct LocalPlane {
  Vector3d normal = Vector3d::Zero();
  double off_mm = 0;
};

LocalPlane PlaneOf(std::span<const Vector3d> points, const std::vector<std::size_t>& around) {
  if (around.size() < kLeastNeighbours) return {};
  Vector3d mean = Vector3d::Zero();
  for (const std::size_t i : around) mean += points[i];
  mean /= static_cast<double>(around.size());
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const std::size_t i : around) {
    spread += (points[i] - mean) * (points[i] - mean).transpose();
  }
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen;
  eigen.computeDirect(spread);
  const Vector3d values = eigen.eigenvalues();
  if (!(values[1] > 1e-6 * values[2])) return {};  // a line
  return {eigen.eigenvectors().col(0),
          std::sqrt(std::max(0.0, values[0]) / static_cast<double>(around.size()))};
}

// [rad] Of the directions to the neighbours, in the plane.
double WidestGap(std::span<const Vector3d> points, std::size_t at,
                 const std::vector<std::size_t>& around, const Vector3d& normal) {
  const Vector3d x = normal.unitOrthogonal(), y = normal.cross(x);
  std::vector<double> angles;
  for (const std::size_t i : around) {
    if (i == at) continue;
    const Vector3d off = points[i] - points[at];
    angles.push_back(std::atan2(off.dot(y), off.dot(x)));
  }
  if (angles.empty()) return 2 * std::numbers::pi;
  std::sort(angles.begin(), angles.end());
  double widest = angles.front() + 2 * std::numbers::pi - angles.back();
  for (std::size_t k = 1; k < angles.size(); ++k)
    widest = std::max(widest, angles[k] - angles[k - 1]);
  return widest;
}

}  // namespace

std::vector<PointCharacteristics> CharacteriseSurface(std::span<const Vector3d> points_mm,
                                                      const PointIndex& index, double reach_mm,
                                                      Workers* workers) {
  std::vector<PointCharacteristics> all(points_mm.size());
  const std::size_t rounds = (points_mm.size() + kOfRound - 1) / kOfRound;
  const auto for_each = [&](const auto& body) {
    ParallelFor(workers, rounds, [&](std::size_t round) {
      std::vector<std::size_t> around;
      const std::size_t end = std::min(points_mm.size(), (round + 1) * kOfRound);
      for (std::size_t i = round * kOfRound; i < end; ++i) {
        around.clear();
        index.Visit(points_mm[i], reach_mm, [&](std::size_t k) { around.push_back(k); });
        body(i, around);
      }
    });
  };
  for_each([&](std::size_t i, const std::vector<std::size_t>& around) {
    const LocalPlane plane = PlaneOf(points_mm, around);
    all[i].normal = plane.normal;
    all[i].off_plane_mm = plane.off_mm;
    all[i].gap = plane.normal.isZero() ? 2 * std::numbers::pi
                                       : WidestGap(points_mm, i, around, plane.normal);
  });
  for_each([&](std::size_t i, const std::vector<std::size_t>& around) {
    double least = 1;
    for (const std::size_t k : around) {
      if (all[k].normal.isZero()) continue;
      least = std::min(least, std::abs(all[i].normal.dot(all[k].normal)));
    }
    all[i].normal_turn = all[i].normal.isZero() ? 0 : std::acos(least);
  });
  return all;
}

}  // namespace bendloop::pipeline
