// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

namespace bendloop::pipeline {

// Samples in a plane, in square cells, for those who ask many times which is nearest.
class PlaneSamples {
 public:
  explicit PlaneSamples(std::span<const Eigen::Vector2d> samples);

  // How far the nearest sample is; very far without any.
  double NearestMm(const Eigen::Vector2d& place) const;

 private:
  using Cell = Eigen::Vector2i;
  Cell CellOf(const Eigen::Vector2d& place) const;
  // The nearest of one cell's, squared, or `nearest`.
  double NearestIn(const Cell& cell, const Eigen::Vector2d& place, double nearest) const;

  Eigen::Vector2d low_mm_ = Eigen::Vector2d::Zero();
  double cell_mm_ = 1.0;
  Cell cells_ = Cell::Zero();  // how many each way
  std::vector<std::uint32_t> begin_;
  std::vector<Eigen::Vector2d> samples_;  // cell by cell
};

}  // namespace bendloop::pipeline
