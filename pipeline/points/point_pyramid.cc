// SPDX-License-Identifier: Apache-2.0
#include "pipeline/points/point_pyramid.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace bendloop::pipeline {
namespace {

// The bits of a number, each three places from the last.
std::uint64_t Spread(std::uint64_t x) {
  x = (x | x << 32) & 0x001f00000000ffffu;
  x = (x | x << 16) & 0x001f0000ff0000ffu;
  x = (x | x << 8) & 0x100f00f00f00f00fu;
  x = (x | x << 4) & 0x10c30c30c30c30c3u;
  return (x | x << 2) & 0x1249249249249249u;
}

// By key; what has the same one keeps its order.
template <class Item>
void RadixSort(std::vector<Item>& items, int bits) {
  constexpr int kDigit = 11;
  std::vector<Item> other(items.size());
  for (int shift = 0; shift < bits; shift += kDigit) {
    std::array<std::uint32_t, (1 << kDigit) + 1> next{};
    const auto digit = [shift](const Item& item) {
      return static_cast<std::size_t>(item.key >> shift) & ((1 << kDigit) - 1);
    };
    for (const Item& item : items) ++next[digit(item) + 1];
    for (std::size_t i = 1; i < next.size(); ++i) next[i] += next[i - 1];
    for (const Item& item : items) other[next[digit(item)]++] = item;
    items.swap(other);
  }
}

}  // namespace

PointPyramid::PointPyramid(std::span<const Eigen::Vector3d> points) : points_(points) {
  if (points.empty()) return;
  Eigen::Vector3d high_mm = points.front();
  low_mm_ = points.front();
  for (const Eigen::Vector3d& p : points) {
    low_mm_ = low_mm_.cwiseMin(p);
    high_mm = high_mm.cwiseMax(p);
  }
  // A little more, so that no point lies on the far faces.
  size_mm_ = std::max(1e-9, 1.000001 * (high_mm - low_mm_).maxCoeff());
  sorted_.reserve(points.size());
  for (const Eigen::Vector3d& p : points) {
    const Eigen::Vector3i finest = FinestOf(p);
    const auto part = [&finest](Eigen::Index axis) {
      return Spread(static_cast<std::uint64_t>(finest[axis]));
    };
    sorted_.push_back(
        {part(0) << 2 | part(1) << 1 | part(2), static_cast<std::uint32_t>(sorted_.size())});
  }
  RadixSort(sorted_, 3 * kBits);
}

Eigen::Vector3i PointPyramid::FinestOf(const Eigen::Vector3d& point) const {
  return ((point - low_mm_) * ((1 << kBits) / size_mm_)).cast<int>();
}

const PointPyramid::Level& PointPyramid::Thinned(double voxel_mm) {
  const double exact = std::ceil(std::log2(size_mm_ / voxel_mm));
  const auto halvings = static_cast<int>(std::clamp<double>(exact, kVoxelBits, kBits));
  std::optional<Level>& level = levels_[static_cast<std::size_t>(halvings)];
  if (!level) level = MakeLevel(halvings);
  return *level;
}

PointPyramid::Level PointPyramid::MakeLevel(int halvings) const {
  Level level;
  level.low_mm_ = low_mm_;
  const int voxel_shift = kBits - halvings;
  const int cell_shift = voxel_shift + kVoxelBits;
  level.cell_mm_ = std::ldexp(size_mm_, kVoxelBits - halvings);
  level.last_cell_ = (1 << (halvings - kVoxelBits)) - 1;
  std::uint64_t cell = ~std::uint64_t{0};
  for (std::size_t i = 0; i < sorted_.size();) {
    const std::uint64_t voxel = sorted_[i].key >> 3 * voxel_shift;
    std::uint32_t first = sorted_[i].index;
    for (++i; i < sorted_.size() && sorted_[i].key >> 3 * voxel_shift == voxel; ++i) {
      first = std::min(first, sorted_[i].index);
    }
    const Eigen::Vector3d& point = points_[first];
    if (sorted_[i - 1].key >> 3 * cell_shift != cell) {
      cell = sorted_[i - 1].key >> 3 * cell_shift;
      level.cells_.FindOrAdd(FinestOf(point).unaryExpr([=](int c) { return c >> cell_shift; }));
      level.begin_.push_back(static_cast<std::uint32_t>(level.points_.size()));
    }
    level.points_.push_back(point);
  }
  return level;
}

void PointPyramid::Level::GatherBall(const Eigen::Vector3d& center, double radius_mm,
                                     std::vector<Eigen::Vector3d>& out) const {
  out.clear();
  const double radius2 = radius_mm * radius_mm;
  const Eigen::Vector3d at = center - low_mm_;
  const auto cell_of = [this](const Eigen::Vector3d& p) -> Eigen::Vector3i {
    return (p / cell_mm_).array().floor().cwiseMax(0.0).cwiseMin(last_cell_).cast<int>();
  };
  const Eigen::Vector3i low = cell_of(at - Eigen::Vector3d::Constant(radius_mm));
  const Eigen::Vector3i high = cell_of(at + Eigen::Vector3d::Constant(radius_mm));
  std::size_t count = 0;
  for (int x = low.x(); x <= high.x(); ++x) {
    for (int y = low.y(); y <= high.y(); ++y) {
      for (int z = low.z(); z <= high.z(); ++z) {
        const std::int32_t cell = cells_.Find({x, y, z});
        if (cell < 0) continue;
        const auto k = static_cast<std::size_t>(cell);
        const std::size_t end = k + 1 < begin_.size() ? begin_[k + 1] : points_.size();
        out.resize(count + end - begin_[k]);
        for (std::size_t i = begin_[k]; i < end; ++i) {
          out[count] = points_[i];
          count += (points_[i] - center).squaredNorm() < radius2 ? 1 : 0;
        }
      }
    }
  }
  out.resize(count);
}

}  // namespace bendloop::pipeline
