// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <span>
#include <unordered_map>
#include <vector>

namespace bendloop::pipeline {

// Key of the cube of edge `cell` that holds the point; places a million cells away share keys,
// which costs time and nothing else.
inline std::uint64_t CellKey(const Eigen::Vector3i& cell) {
  const auto part = [](int c) {
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(c) + (1 << 20)) & 0x1fffff;
  };
  return (part(cell.x()) << 42) | (part(cell.y()) << 21) | part(cell.z());
}

inline Eigen::Vector3i CellOf(const Eigen::Vector3d& point, double cell_mm) {
  return (point / cell_mm).array().floor().cwiseMax(-1e9).cwiseMin(1e9).cast<int>();
}

// Points by place, for "who is within `radius`". Holds indices; the points stay with the caller.
class PointIndex {
 public:
  PointIndex(std::span<const Eigen::Vector3d> points, double cell_mm)
      : points_(points), cell_mm_(cell_mm) {
    for (std::size_t i = 0; i < points.size(); ++i) {
      cells_[CellKey(CellOf(points[i], cell_mm))].push_back(i);
    }
  }

  // Calls visit(index) for every point within `radius_mm`, in an order that depends on the points
  // only.
  template <class F>
  void Visit(const Eigen::Vector3d& at, double radius_mm, F visit) const {
    const Eigen::Vector3d reach = Eigen::Vector3d::Constant(radius_mm);
    const Eigen::Vector3i low = CellOf(at - reach, cell_mm_);
    const Eigen::Vector3i high = CellOf(at + reach, cell_mm_);
    for (int x = low.x(); x <= high.x(); ++x) {
      for (int y = low.y(); y <= high.y(); ++y) {
        for (int z = low.z(); z <= high.z(); ++z) {
          const auto found = cells_.find(CellKey({x, y, z}));
          if (found == cells_.end()) continue;
          for (const std::size_t i : found->second) {
            if ((points_[i] - at).squaredNorm() < radius_mm * radius_mm) visit(i);
          }
        }
      }
    }
  }

 private:
  std::span<const Eigen::Vector3d> points_;
  double cell_mm_;
  std::unordered_map<std::uint64_t, std::vector<std::size_t>> cells_;
};

// Mean of the points in each cube, in a fixed order of the cubes.
inline std::vector<Eigen::Vector3d> CellMeans(std::span<const Eigen::Vector3d> points,
                                              double cell_mm) {
  std::map<std::uint64_t, std::pair<Eigen::Vector3d, double>> cells;
  for (const Eigen::Vector3d& point : points) {
    auto [place, created] =
        cells.try_emplace(CellKey(CellOf(point, cell_mm)), Eigen::Vector3d::Zero().eval(), 0.0);
    place->second.first += point;
    place->second.second += 1;
  }
  std::vector<Eigen::Vector3d> means;
  means.reserve(cells.size());
  for (const auto& [key, sum] : cells) means.push_back(sum.first / sum.second);
  return means;
}

}  // namespace bendloop::pipeline
