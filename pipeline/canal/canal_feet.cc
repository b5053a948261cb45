// SPDX-License-Identifier: Apache-2.0
#include "pipeline/canal/canal_feet.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <unordered_map>

#include "pipeline/points/point_index.h"

namespace bendloop::pipeline {
namespace {

// Spheres of the surface at even steps of the parameter.
struct Spheres {
  std::vector<Eigen::Vector3d> centers_mm;
  std::vector<double> radii_mm;
  double widest_mm = 0;
};

// Four a radius: the nearest of them is a start from which Newton's method finds the foot.
Spheres SpheresOf(const CanalSurface& surface, double radius_mm) {
  const double length_mm = surface.ArcLengths(8 * surface.spans()).back();
  const int steps = static_cast<int>(std::clamp(4 * length_mm / radius_mm, 8.0, 40'000.0));
  Spheres spheres;
  for (int i = 0; i <= steps; ++i) {
    const Eigen::Vector4d c = surface.At(static_cast<double>(surface.spans()) * i / steps);
    spheres.centers_mm.emplace_back(c.head<3>());
    spheres.radii_mm.push_back(c[3]);
    spheres.widest_mm = std::max(spheres.widest_mm, c[3]);
  }
  return spheres;
}

}  // namespace

std::vector<CanalFoot> FindFeet(const CanalSurface& surface,
                                std::span<const Eigen::Vector3d> points, double radius_mm,
                                double reach) {
  const Spheres spheres = SpheresOf(surface, radius_mm);
  const auto& [centers, radii, widest_mm] = spheres;
  const int steps = static_cast<int>(centers.size()) - 1;
  const double far_mm = widest_mm * (1 + reach);
  // Points of one cell share their candidates.
  const double cell_mm = 0.5 * radius_mm;
  std::unordered_map<std::uint64_t, std::vector<std::size_t>> cells;
  std::vector<std::uint64_t> order;
  for (std::size_t i = 0; i < points.size(); ++i) {
    auto [place, created] = cells.try_emplace(CellKey(CellOf(points[i], cell_mm)));
    if (created) order.push_back(place->first);
    place->second.push_back(i);
  }
  const PointIndex index(centers, std::max(0.5 * far_mm, radius_mm));
  std::vector<CanalFoot> feet(points.size(), CanalFoot{0, 0, true});
  std::vector<std::size_t> near;
  for (const std::uint64_t key : order) {
    const std::vector<std::size_t>& members = cells[key];
    near.clear();
    const Eigen::Vector3d middle =
        (CellOf(points[members.front()], cell_mm).cast<double>() + Eigen::Vector3d::Constant(0.5)) *
        cell_mm;
    index.Visit(middle, far_mm + cell_mm, [&](std::size_t j) { near.push_back(j); });
    std::sort(near.begin(), near.end());
    for (const std::size_t i : members) {
      double best = std::numeric_limits<double>::infinity();
      std::size_t at = 0;
      for (const std::size_t j : near) {
        const double d = (points[i] - centers[j]).norm() - radii[j];
        if (d < best) {
          best = d;
          at = j;
        }
      }
      if (!std::isfinite(best)) continue;
      feet[i] = surface.FootNear(
          points[i], static_cast<double>(surface.spans() * static_cast<int>(at)) / steps);
      if (std::abs(feet[i].distance_mm) > reach * radii[at]) feet[i].beyond = true;
    }
  }
  return feet;
}

}  // namespace bendloop::pipeline
