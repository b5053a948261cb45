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
  // Of one of the samples, how far the nearest of the others is.
  double NearestOtherMm(const Eigen::Vector2d& sample) const;

 private:
  using Cell = Eigen::Vector2i;
  Cell CellOf(const Eigen::Vector2d& place) const;
  // The least of all squared distances, kept by `nearest`: Take() has one more, Most() says beyond
  // which none is asked for.
  template <class Nearest>
  double Search(const Eigen::Vector2d& place, Nearest nearest) const;

  Eigen::Vector2d low_mm_ = Eigen::Vector2d::Zero();
  double cell_mm_ = 1.0;
  Cell cells_ = Cell::Zero();  // how many each way
  std::vector<std::uint32_t> begin_;
  std::vector<Eigen::Vector2d> samples_;  // cell by cell
};

}  // namespace bendloop::pipeline
