// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/regions.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <numeric>

namespace bendloop::pipeline {
namespace {

class Growing {
 public:
  Growing(std::span<const Eigen::Vector3d> points_mm, const PointIndex& index,
          std::span<const PointCharacteristics> characteristics, const RegionOptions& options)
      : points_(points_mm),
        index_(index),
        of_(characteristics),
        options_(options),
        region_(points_mm.size(), Regions::kNone) {}

  Regions Run() {
    for (std::size_t i = 0; i < points_.size(); ++i) {
      if (region_[i] == Regions::kNone && IsSmooth(i)) GrowFrom(i);
    }
    Rank();
    Fill();
    Regions regions;
    regions.count = kept_.size();
    regions.of_point = region_;
    std::vector<std::size_t> deep(regions.count, 0), all(regions.count, 0);
    for (std::size_t i = 0; i < points_.size(); ++i) {
      if (region_[i] == Regions::kNone) continue;
      const auto r = static_cast<std::size_t>(region_[i]);
      ++all[r];
      deep[r] += IsDeep(i) ? 1 : 0;
    }
    for (std::size_t r = 0; r < regions.count; ++r) regions.concave.push_back(2 * deep[r] > all[r]);
    return regions;
  }

 private:
  bool IsSmooth(std::size_t i) const {
    return !of_[i].normal.isZero() && of_[i].normal_turn < options_.normal_turn;
  }
  bool IsDeep(std::size_t i) const { return of_[i].concavity_mm > options_.concavity_mm; }

  void GrowFrom(std::size_t seed) {
    const int number = static_cast<int>(sizes_.size());
    sizes_.push_back(0);
    std::deque<std::size_t> front = {seed};
    region_[seed] = number;
    while (!front.empty()) {
      const std::size_t i = front.front();
      front.pop_front();
      ++sizes_.back();
      index_.Visit(points_[i], options_.reach_mm, [&](std::size_t k) {
        if (region_[k] != Regions::kNone || !IsSmooth(k) || IsDeep(k) != IsDeep(i)) return;
        region_[k] = number;
        front.push_back(k);
      });
    }
  }

  // Numbers by size; what is too small is none.
  void Rank() {
    std::vector<std::size_t> order(sizes_.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return sizes_[a] > sizes_[b]; });
    std::vector<int> rank(sizes_.size(), Regions::kNone);
    for (const std::size_t r : order) {
      if (sizes_[r] < options_.least_points) break;
      rank[r] = static_cast<int>(kept_.size());
      kept_.push_back(r);
    }
    for (int& r : region_) r = r == Regions::kNone ? r : rank[static_cast<std::size_t>(r)];
  }

  // Points of none go to the region that reaches them first, all regions a step at a time.
  void Fill() {
    std::deque<std::size_t> front;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      if (region_[i] != Regions::kNone) front.push_back(i);
    }
    while (!front.empty()) {
      const std::size_t i = front.front();
      front.pop_front();
      index_.Visit(points_[i], options_.reach_mm, [&](std::size_t k) {
        if (region_[k] != Regions::kNone) return;
        region_[k] = region_[i];
        front.push_back(k);
      });
    }
  }

  std::span<const Eigen::Vector3d> points_;
  const PointIndex& index_;
  std::span<const PointCharacteristics> of_;
  const RegionOptions& options_;
  std::vector<int> region_;
  std::vector<std::size_t> sizes_, kept_;
};

}  // namespace

Regions GrowRegions(std::span<const Eigen::Vector3d> points_mm, const PointIndex& index,
                    std::span<const PointCharacteristics> characteristics,
                    const RegionOptions& options) {
  return Growing(points_mm, index, characteristics, options).Run();
}

}  // namespace bendloop::pipeline
