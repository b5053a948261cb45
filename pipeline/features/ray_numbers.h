// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

namespace bendloop::pipeline {

// Two samples of a laser line that follow each other, by where round the tube they lie: y of the
// unrolled wall, the second beyond the first.
struct NeighbouringRays {
  double from_mm = 0, to_mm = 0;
};

// Which ray of a pass' laser line meets the wall where, counted from anywhere: from each ray to the
// next it grows by 1. Rays that come in flat lie far apart, so it is a series (Chebyshev's) in y.
class RayNumbers {
 public:
  // That under which neighbours, most of which are one ray apart, are so; none of too few.
  static std::optional<RayNumbers> Of(std::span<const NeighbouringRays> neighbours);

  double At(double y_mm) const;
  // How far apart the rays are there.
  double PitchMm(double y_mm) const;
  // Where a ray of this number meets the wall; `near_mm`: about where.
  double PlaceMm(double number, double near_mm) const;
  // 1 sigma of where a ray is beside its neighbours, of the distance of two.
  double uneven() const { return uneven_; }

 private:
  // Values of the series' terms from the first on (of the constant one nothing is known), and their
  // slopes.
  struct Terms {
    Eigen::VectorXd values, slopes;
  };
  Terms TermsAt(double y_mm) const;
  // Seeks the weights, whose number is given; whether the number grows all the way then.
  bool FitTo(std::span<const NeighbouringRays> neighbours);

  double middle_mm_ = 0, half_mm_ = 1;
  Eigen::VectorXd weights_;
  double uneven_ = 0;
};

}  // namespace bendloop::pipeline
