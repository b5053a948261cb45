// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

namespace bendloop::pipeline {

// A sample about a place: where in the plane across the outward direction there, and how far out of
// the round wall.
struct OffWall {
  Eigen::Vector2d place_mm = Eigen::Vector2d::Zero();
  double off_mm = 0;
};

// How the wall lies off the round one about a place, as an oval or displaced tube's does: a
// quadratic form under which most samples lie evenly.
class LocalWall {
 public:
  // `noise_mm`: 1 sigma of a sample, at least.
  LocalWall(std::span<const OffWall> samples, double reach_mm, double noise_mm);

  // How far a sample lies below this wall [sigma].
  double SigmasBelow(const OffWall& sample) const;

 private:
  using Numbers = Eigen::Matrix<double, 6, 1>;
  Numbers RowAt(const Eigen::Vector2d& place_mm) const;

  double reach_mm_, sigma_mm_;
  Numbers form_ = Numbers::Zero();
};

}  // namespace bendloop::pipeline
