// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/nn_crust.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <tuple>
#include <unordered_map>

namespace bendloop::pipeline {
namespace {

// Calls visit(j, squared distance) for every point j != i within the cube size of point i.
class Lookup {
 public:
  Lookup(std::span<const Eigen::Vector3d> points, double cube_mm)
      : points_(points), cube_mm_(cube_mm) {
    for (std::size_t i = 0; i < points.size(); ++i) {
      cubes_[Key(CellOf(points[i]))].push_back(static_cast<int>(i));
    }
  }

  template <class Visit>
  void Near(int i, Visit visit) const {
    const Eigen::Vector3d& p = points_[static_cast<std::size_t>(i)];
    const Eigen::Vector3i cell = CellOf(p);
    for (int x = -1; x <= 1; ++x) {
      for (int y = -1; y <= 1; ++y) {
        for (int z = -1; z <= 1; ++z) {
          const auto found = cubes_.find(Key(cell + Eigen::Vector3i(x, y, z)));
          if (found == cubes_.end()) continue;
          for (const int j : found->second) {
            const double d2 = (points_[static_cast<std::size_t>(j)] - p).squaredNorm();
            if (j != i && d2 <= cube_mm_ * cube_mm_) visit(j, d2);
          }
        }
      }
    }
  }

 private:
  Eigen::Vector3i CellOf(const Eigen::Vector3d& p) const {
    return (p / cube_mm_).array().floor().cast<int>();
  }
  static std::uint64_t Key(const Eigen::Vector3i& c) {
    const auto part = [](int v) { return static_cast<std::uint64_t>(v + (1 << 20)) & 0x1fffff; };
    return (part(c.x()) << 42) | (part(c.y()) << 21) | part(c.z());
  }

  std::span<const Eigen::Vector3d> points_;
  double cube_mm_;
  std::unordered_map<std::uint64_t, std::vector<int>> cubes_;
};

}  // namespace

std::vector<CurveNeighbours> NnCrust(std::span<const Eigen::Vector3d> points, double max_edge_mm) {
  const Lookup lookup(points, max_edge_mm);
  std::vector<std::tuple<double, int, int>> edges;  // squared length, i < j
  const auto add = [&edges](double d2, int i, int j) {
    edges.emplace_back(d2, std::min(i, j), std::max(i, j));
  };
  for (int i = 0; i < static_cast<int>(points.size()); ++i) {
    const Eigen::Vector3d& p = points[static_cast<std::size_t>(i)];
    int nearest = -1;
    double nearest2 = std::numeric_limits<double>::infinity();
    lookup.Near(i, [&](int j, double d2) {
      if (d2 < nearest2 || (d2 == nearest2 && j < nearest)) {
        nearest = j;
        nearest2 = d2;
      }
    });
    if (nearest < 0) continue;
    add(nearest2, i, nearest);
    const Eigen::Vector3d first = points[static_cast<std::size_t>(nearest)] - p;
    int half = -1;
    double half2 = std::numeric_limits<double>::infinity();
    lookup.Near(i, [&](int j, double d2) {
      if ((points[static_cast<std::size_t>(j)] - p).dot(first) >= 0) return;
      if (d2 < half2 || (d2 == half2 && j < half)) {
        half = j;
        half2 = d2;
      }
    });
    if (half >= 0) add(half2, i, half);
  }
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());

  std::vector<CurveNeighbours> neighbours(points.size(), CurveNeighbours{-1, -1});
  const auto free_slot = [&neighbours](int i) {
    const auto& n = neighbours[static_cast<std::size_t>(i)];
    return n[0] < 0 ? 0 : n[1] < 0 ? 1 : -1;
  };
  for (const auto& [d2, i, j] : edges) {
    const int slot_i = free_slot(i);
    const int slot_j = free_slot(j);
    if (slot_i < 0 || slot_j < 0) continue;
    neighbours[static_cast<std::size_t>(i)][static_cast<std::size_t>(slot_i)] = j;
    neighbours[static_cast<std::size_t>(j)][static_cast<std::size_t>(slot_j)] = i;
  }
  return neighbours;
}

}  // namespace bendloop::pipeline
